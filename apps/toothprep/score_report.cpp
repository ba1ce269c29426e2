#include "score_report.h"

#include <algorithm>
#include <cmath>

#include "session_options.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/compare/cut_surface.h"
#include "toothprep/tools/compare/deviation_file.h"
#include "toothprep/tools/io/write_file.h"
#include "toothprep/tools/render/overlay.h"
#include "toothprep/tools/render/renderer.h"
#include "toothprep/tools/score_report/score_page.h"
#include "toothprep/tools/view/report_scene.h"

namespace toothprep::app {
namespace {

constexpr int kWidth = 720, kHeight = 540;  // pixels, of one picture
constexpr int kSmallWidth = 240;            // of the thumbnail

// Draws pictures of the prepared region, all from the same place at the same scale.
class Studio {
 public:
  explicit Studio(const Assessment& assessment) : assessment_(assessment) {
    const PreparationFrame& frame = assessment.preparation.frame;
    axes_ = {frame.d,           frame.u,          frame.v, frame.axis_source != "found",
             frame.sides_known, frame.sides_known};
    double reach = 1;  // mm, from the middle of the cut
    const std::vector<float> depth =
        depth_inside(assessment.preparation_surface, assessment.original.tooth);
    for (std::size_t v = 0; v < depth.size(); ++v)
      if (depth[v] > 0.5 * assessment.original.tooth.lattice.voxel)
        reach = std::max(
            reach,
            (assessment.preparation_surface.vertices[v].cast<double>() - frame.origin).norm());
    fit_.width = kWidth;
    fit_.height = kHeight;
    fit_.centre = frame.origin;
    fit_.mm_per_pixel = 2.5 * reach / kHeight;
    options_.samples = 2;
    options_.ambient_rays = 32;
  }

  RenderPart prepared() const {
    if (assessment_.prepared.tooth.parts) return part_of(assessment_.prepared.tooth);
    RenderPart part;
    part.mesh = assessment_.preparation_surface;
    part.tooth = &assessment_.prepared.tooth;
    return part;
  }
  RenderPart original() const {
    if (!assessment_.original.layered) return part_of(assessment_.original.tooth);
    RenderPart part;
    part.mesh = assessment_.original.surface;
    part.tooth = &assessment_.original.tooth;
    return part;
  }
  // The prepared surface with one number per vertex, red where positive, blue where negative.
  static RenderPart coloured(const TriangleMesh& surface, std::vector<float> values) {
    RenderPart part;
    part.mesh = surface;
    part.deviation = std::move(values);
    part.colour = ColourBy::kDeviation;
    return part;
  }

  static Renderer scene_of(RenderPart part) {
    std::vector<RenderPart> parts;
    parts.push_back(std::move(part));
    return Renderer(std::move(parts));
  }

  Picture draw(const Renderer& renderer, const std::string& view) const {
    const Camera camera = fit_camera(view_of(view, axes_), renderer.meshes(), fit_);
    Picture picture = picture_of(renderer.render(camera, options_));
    draw_scale_bar(picture, camera.mm_per_pixel);
    draw_triad(picture, camera, axes_);
    return picture;
  }

  // The same, for a table of many.
  Picture draw_small(const Renderer& renderer, const std::string& view) const {
    Fit fit = fit_;
    fit.width = kSmallWidth;
    fit.height = kSmallWidth * kHeight / kWidth;
    fit.mm_per_pixel = fit_.mm_per_pixel * kWidth / kSmallWidth;
    return picture_of(
        renderer.render(fit_camera(view_of(view, axes_), renderer.meshes(), fit), options_));
  }

  // Cut through the middle of the preparation, seen at the cut.
  Picture draw_cut(const Renderer& renderer, const Vec3& removed_side) const {
    RenderOptions options = options_;
    options.cut = CutPlane{assessment_.preparation.frame.origin, removed_side};
    const View view{"cut", -removed_side, axes_.occlusal};
    const Camera camera = fit_camera(view, renderer.meshes(), fit_);
    Picture picture = picture_of(renderer.render(camera, options));
    draw_scale_bar(picture, camera.mm_per_pixel);
    draw_triad(picture, camera, axes_);
    return picture;
  }

  const ToothAxes& axes() const { return axes_; }

 private:
  const Assessment& assessment_;
  ToothAxes axes_;
  Fit fit_;
  RenderOptions options_;
};

std::vector<float> undercut_marks(const Assessment& assessment) {
  std::vector<float> marks(assessment.preparation_surface.vertices.size(), NAN);
  for (const std::uint32_t t : assessment.preparation.undercut_triangles)
    for (const std::uint32_t v : assessment.preparation_surface.triangles[t]) marks[v] = 1;
  return marks;
}

using Progress = std::function<void(const std::string& stage, double done)>;

std::vector<PagePicture> pictures_of(const Studio& studio, RenderPart original,
                                     const Renderer& prepared, const Assessment& assessment,
                                     const Progress& progress) {
  const double all = 4 + (assessment.deviation ? 2 : 0) +
                     (assessment.preparation.undercut_triangles.empty() ? 0 : 1) + 1;
  std::vector<PagePicture> pictures;
  if (progress) progress("drawing the report", 0);
  const auto add = [&](const std::string& caption, const Picture& picture) {
    pictures.push_back({caption, png_bytes(picture)});
    if (progress) progress("drawing the report", static_cast<double>(pictures.size()) / all);
  };
  add("Before, from the occlusal", studio.draw(Studio::scene_of(std::move(original)), "occlusal"));
  add("After, from the occlusal", studio.draw(prepared, "occlusal"));
  add("After, oblique", studio.draw(prepared, "oblique"));
  // From the side from which the mesiodistal section is drawn.
  const PreparationFrame& frame = assessment.preparation.frame;
  add("Cut open from mesial to distal", studio.draw_cut(prepared, frame.u.cross(frame.d)));
  if (assessment.deviation) {
    const Renderer coloured = Studio::scene_of(
        Studio::coloured(assessment.prepared.surface, assessment.deviation->per_vertex));
    const auto deviation = [&](const char* view) {
      Picture picture = studio.draw(coloured, view);
      draw_colour_bar(picture, RenderOptions{}.range);
      return picture;
    };
    add("Deviation from the target: red where material was left, blue where too much was taken",
        deviation("occlusal"));
    add("Deviation from the target, oblique", deviation("oblique"));
  }
  if (!assessment.preparation.undercut_triangles.empty())
    add("Undercuts along the path of draw (red)",
        studio.draw(Studio::scene_of(Studio::coloured(assessment.preparation_surface,
                                                      undercut_marks(assessment))),
                    "oblique"));
  return pictures;
}

}  // namespace

void write_score_report(const Assessment& assessment, const ProcessOptions& process,
                        const std::string& folder, const Progress& progress) {
  ScorePage page;
  page.sheet = assessment.sheet;
  const Studio studio(assessment);
  const Renderer prepared = Studio::scene_of(studio.prepared());
  RenderPart original = studio.original();
  TriangleMesh before = original.mesh;
  page.pictures = pictures_of(studio, std::move(original), prepared, assessment, progress);
  page.sections = assessment.preparation.sections;
  if (assessment.deviation) {
    const std::vector<float>& values = assessment.deviation->per_vertex;
    page.deviation = deviation_histogram(std::vector<double>(values.begin(), values.end()),
                                         vertex_areas(assessment.prepared.surface));
    for (const char* name : {"/deviation.ply", "/deviation.vtk"})
      write_deviation(assessment.prepared.surface, values, folder + name);
  }
  if (assessment.trace)
    page.trace = trace_plot(assessment.trace->rows, assessment.process->events, process);
  const ScenePart scene =
      scene_part({std::move(before), assessment.prepared.surface,
                  assessment.deviation ? assessment.deviation->per_vertex : std::vector<float>(),
                  studio.axes()});
  page.scene = scene.markup;
  page.script_policy = scene.policy;
  write_mesh(assessment.preparation_surface, folder + "/prepared.ply");
  write_file(folder + "/report.html", score_page_html(page));
  write_file(folder + "/thumbnail.png", png_bytes(studio.draw_small(prepared, "occlusal")));
  if (progress) progress("drawing the report", 1);
}

}  // namespace toothprep::app
