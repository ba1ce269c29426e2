#include "toothprep/tools/preparation/profile.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "toothprep/step/core/units.h"
#include "toothprep/tools/preparation/corner_fit.h"

namespace toothprep {
namespace {

constexpr double kDegree = units::from_degree(1);
constexpr double kAbove = 50;  // mm, well out of the tooth
// Of the wall that is looked at beside a corner, the part away from it, that is in no arc.
constexpr double kBesideArc = 0.25;

// An upright plane across a margin: x outwards from where the wall, extended down, stands at the
// finish line's height; z up from there.
class ProfilePlane {
 public:
  ProfilePlane(const MarginStation& station, const PreparationFrame& frame)
      : out_(station.across),
        up_(frame.d),
        origin_(station.at - station.width * station.across),
        wall_angle_(std::asin(std::clamp(station.wall_normal.dot(frame.d), -1.0, 1.0))) {}

  double wall_angle() const { return wall_angle_; }  // radians, positive: leans inwards
  double wall_at(double z) const { return -z * std::tan(wall_angle_); }
  Vec3 at(double x, double z) const { return origin_ + x * out_ + z * up_; }
  Vec2 flat(const Vec3& p) const { return {(p - origin_).dot(out_), (p - origin_).dot(up_)}; }
  const Vec3& out() const { return out_; }
  const Vec3& up() const { return up_; }

  // Where a ray in the plane meets the cut from outside; false if it meets something else.
  bool meets(const TriangleTree& tree, const CutFacets& facets, const Vec2& from,
             const Vec3& direction, double reach, Vec2& place) const {
    const auto hit = tree.first_hit(at(from.x(), from.y()), direction, 0, reach);
    if (!hit || facets.facet_of(hit->triangle) < 0) return false;
    if (tree.normal(hit->triangle).dot(direction) >= 0) return false;
    place = flat(hit->point);
    return true;
  }

 private:
  Vec3 out_, up_, origin_;
  double wall_angle_;
};

// Points of a corner's profile, the wall's apart, with the wall along x = 0 as far as it is straight.
// Steps of labels and noise let it be elsewhere here than the middle of the wall says.
class Profile {
 public:
  void add(const Vec2& p) { points_.push_back(p); }
  // One of the wall, how far inside of the wall extended it lies, and whether it's away from the
  // corner.
  void add_wall(const Vec2& p, double within, bool away) {
    add(p);
    if (!away) return;
    within_ += within;
    ++away_;
  }
  // How far the wall lies inside, mm; nothing if it was not found. What is farther than a voxel is
  // no error of the wall: the edge above a low one, or a wide arc.
  std::optional<double> move_to_wall(double voxel) {
    if (away_ == 0) return std::nullopt;
    const double way = within_ / away_;
    if (!(std::abs(way) < voxel)) return 0;
    for (Vec2& p : points_) p.x() -= way;
    return way;
  }
  const std::vector<Vec2>& points() const { return points_; }

 private:
  std::vector<Vec2> points_;
  double within_ = 0;  // sum over the wall's points that are away
  int away_ = 0;
};

// The cut along the profile from the wall to the finish line, but for the strip at its end that
// voxels bevel.
Profile ledge_profile(const ProfilePlane& plane, double width, const CutFacets& facets,
                      const TriangleTree& tree, double voxel) {
  const double spacing = std::min(voxel / 2, width / 16), last = width - voxel;
  const double top = 1.5 * width + 0.2;
  Profile profile;
  Vec2 place;
  for (double x = spacing / 2; x < last; x += spacing)
    if (x > plane.wall_at(top) &&
        plane.meets(tree, facets, {x, top}, -plane.up(), 2 * top + width, place))
      profile.add(place);
  for (double z = spacing / 2; z < top; z += spacing)
    if (plane.meets(tree, facets, {width, z}, -plane.out(), 2 * width + top, place))
      profile.add_wall(place, place.x() - plane.wall_at(place.y()), z > (1 - kBesideArc) * top);
  return profile;
}

MarginForm form_of(const CornerFit& fit, double voxel) {
  if (fit.misfit > std::max(voxel / 2, 0.05)) return MarginForm::kIrregular;
  if (fit.arc > 0.5) return MarginForm::kChamfer;
  return fit.slope > kBevelSlope_deg * kDegree ? MarginForm::kBevel : MarginForm::kShoulder;
}

}  // namespace

MarginProfiles measure_profiles(const Margin& margin, const CutFacets& facets,
                                const PreparationFrame& frame, const TriangleTree& prepared,
                                const TriangleTree& original, double voxel) {
  MarginProfiles result;
  for (const MarginStation& station : margin.stations) {
    MarginForm form = MarginForm::kFeatherEdge;
    if (station.width > kNoMargin) {
      const ProfilePlane plane(station, frame);
      Profile profile = ledge_profile(plane, station.width, facets, prepared, voxel);
      const double wall = profile.move_to_wall(voxel).value_or(0);
      const CornerFit fit = fit_corner(profile.points(), plane.wall_angle(), station.width - wall);
      form = form_of(fit, voxel);
      if (form != MarginForm::kIrregular) {
        result.radius.add(fit.radius, 1);
        result.angle.add(fit.angle / kDegree, 1);
        const Vec3 ledge = std::sin(fit.slope) * plane.out() + std::cos(fit.slope) * plane.up();
        const Vec3 side = original.normal(original.nearest(station.at).triangle);
        const Vec2 flat = Vec2(side.dot(plane.out()), side.dot(plane.up())).normalized();
        const double cosine = ledge.dot(flat.x() * plane.out() + flat.y() * plane.up());
        result.cavosurface.add(180 - std::acos(std::clamp(cosine, -1.0, 1.0)) / kDegree, 1);
      }
    }
    result.share[static_cast<std::size_t>(form)] += 1;
  }
  if (!margin.stations.empty())
    for (double& share : result.share) share /= static_cast<double>(margin.stations.size());
  return result;
}

OuterEdge measure_outer_edge(const std::vector<MarginStation>& stations, const CutFacets& facets,
                             const PreparationFrame& frame, const TriangleTree& prepared,
                             double wall_height, double voxel) {
  OuterEdge edge;
  const double reach = std::min(kEdgeReach, 0.4 * wall_height), spacing = voxel / 2;
  if (!(reach > 3 * voxel)) return edge;
  for (const MarginStation& station : stations) {
    const ProfilePlane plane(station, frame);
    // The height at which the occlusal surface lies `reach` within the wall.
    double top = wall_height;
    Vec2 place;
    bool found = false;
    for (int pass = 0; pass < 2; ++pass) {
      found = plane.meets(prepared, facets, {plane.wall_at(top) - reach, kAbove}, -plane.up(),
                          2 * kAbove, place);
      if (!found) break;
      top = place.y();
    }
    if (!found || !(top > reach)) continue;
    // Turned by half, it is a corner like the ledge's: inwards is x, down is y.
    const double wall = plane.wall_at(top);
    Profile profile;
    const auto turned = [&](const Vec2& p) { return Vec2(wall - p.x(), top - p.y()); };
    for (double x = spacing / 2; x < reach; x += spacing)
      if (plane.meets(prepared, facets, {wall - x, kAbove}, -plane.up(), 2 * kAbove, place))
        profile.add(turned(place));
    for (double z = spacing / 2; z < reach; z += spacing)
      if (plane.meets(prepared, facets, {wall + reach / 2, top - z}, -plane.out(), 2 * reach,
                      place))
        profile.add_wall(turned(place), plane.wall_at(place.y()) - place.x(),
                         z > (1 - kBesideArc) * reach);
    if (!profile.move_to_wall(voxel)) continue;
    const CornerFit fit = fit_corner(profile.points(), plane.wall_angle(), reach);
    if (fit.misfit > std::max(voxel / 2, 0.05)) continue;
    edge.radius.add(fit.radius, 1);
    edge.angle.add(fit.angle / kDegree, 1);
    edge.sharp += fit.radius < kSharpRadius;
  }
  if (!edge.radius.empty()) edge.sharp /= edge.radius.weight();
  return edge;
}

}  // namespace toothprep
