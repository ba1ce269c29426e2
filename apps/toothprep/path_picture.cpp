// The picture of a path in a tooth, for `place` and `prepare`.
#include <algorithm>
#include <cmath>

#include "placing.h"
#include "toothprep/tools/render/overlay.h"
#include "toothprep/tools/render/renderer.h"

namespace toothprep::app {
namespace {

using Rgb = std::array<int, 3>;
constexpr Rgb kAir = {120, 130, 150}, kInside = {20, 70, 190}, kNearPulp = {200, 30, 30},
              kBur = {10, 110, 60};
constexpr double kNear = 0.5;  // mm to the pulp

const Rgb& colour_of(const PathPlace& p) {
  if (p.to_pulp && *p.to_pulp < kNear) return kNearPulp;
  return p.below_surface.value_or(0) > 0 ? kInside : kAir;
}

// Runs of one colour, each with the first place of the next.
void draw_path(Picture& picture, const Camera& camera, const std::vector<PathPlace>& places) {
  std::vector<Vec3> run;
  for (std::size_t i = 0; i < places.size(); ++i) {
    run.push_back(places[i].tip);
    const bool last = i + 1 == places.size();
    if (last || colour_of(places[i + 1]) != colour_of(places[i])) {
      if (!last) run.push_back(places[i + 1].tip);
      draw_line(picture, camera, run, colour_of(places[i]));
      run.clear();
    }
  }
}

// The silhouette of the head.
void draw_bur(Picture& picture, const Camera& camera, const Bur& bur, const Pose& pose) {
  const Vec3 axis = pose.orientation * Vec3::UnitZ();
  const Vec3 across = axis.cross(camera.forward);
  if (across.norm() < 0.3) return;  // seen end-on
  const Vec3 side = across.normalized();
  std::vector<Vec3> left, right;
  for (const ProfilePiece& piece : bur.profile())
    for (int i = 0; i <= 8; ++i) {
      const ProfilePoint p = point_on(piece, i / 8.0);
      right.push_back(pose.position + p.z * axis + p.r * side);
      left.push_back(pose.position + p.z * axis - p.r * side);
    }
  draw_line(picture, camera, right, kBur);
  draw_line(picture, camera, left, kBur);
}

// Where the bur stands deep, at both ends of the path along a direction.
std::vector<std::size_t> ends_along(const PathCheck& check, const Vec3& way) {
  std::size_t low = 0, high = 0;
  bool any = false;
  for (std::size_t i = 0; i < check.places.size(); ++i) {
    if (!(check.places[i].below_surface.value_or(0) > 0.6 * check.deepest_below_surface)) continue;
    if (!any) low = high = i;
    any = true;
    if (check.places[i].tip.dot(way) < check.places[low].tip.dot(way)) low = i;
    if (check.places[i].tip.dot(way) > check.places[high].tip.dot(way)) high = i;
  }
  return any ? std::vector<std::size_t>{low, high} : std::vector<std::size_t>{};
}

Pose pose_at(const Trajectory& path, double time) {
  for (const HandleSample& s : path.samples)
    if (s.time >= time && !s.rejected) return s.pose;
  return path.samples.back().pose;
}

}  // namespace

void write_path_picture(const LayeredTooth& tooth, const ToothFrame& frame, const Bur& bur,
                        const Trajectory& path, const PathCheck& check, const std::string& file) {
  std::vector<RenderPart> parts;
  parts.push_back(part_of(tooth));
  const Renderer renderer(std::move(parts));
  const ToothAxes axes = axes_of_frame(frame);
  const PathPlace* deepest = &check.places.front();
  for (const PathPlace& p : check.places)
    if (p.below_surface.value_or(-1e30) > deepest->below_surface.value_or(-1e30)) deepest = &p;
  Fit fit;
  fit.width = 480;
  fit.height = 480;
  RenderOptions options;
  options.samples = 2;
  options.ambient_rays = 48;
  std::vector<Picture> pictures;
  const auto add = [&](const View& view, const std::optional<CutPlane>& cut, const Vec3& along) {
    options.cut = cut;
    fit.mm_per_pixel = 14.0 / fit.width;
    fit.centre = Vec3(0.5 * (check.tips.min + check.tips.max));
    fit.centre = *fit.centre + axes.occlusal.dot(deepest->tip - *fit.centre) * axes.occlusal;
    const Camera camera = fit_camera(view, renderer.meshes(), fit);
    Picture picture = picture_of(renderer.render(camera, options));
    draw_path(picture, camera, check.places);
    for (const std::size_t i : ends_along(check, along))
      draw_bur(picture, camera, bur, pose_at(path, check.places[i].time));
    draw_triad(picture, camera, axes);
    if (pictures.empty()) draw_scale_bar(picture, camera.mm_per_pixel);
    pictures.push_back(std::move(picture));
  };
  add(view_of("occlusal", axes), {}, axes.mesial);
  for (const auto& [normal, along] :
       {std::pair{axes.buccal, axes.mesial}, std::pair{axes.mesial, axes.buccal}}) {
    const CutPlane cut{deepest->tip, normal};
    add(view_at(cut, axes), cut, along);
  }
  write_png(side_by_side(pictures), file);
}

}  // namespace toothprep::app
