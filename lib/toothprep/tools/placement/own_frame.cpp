#include "toothprep/tools/placement/own_frame.h"

#include <Eigen/Dense>
#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/strict_toml.h"

namespace toothprep {
namespace {

// Across `d`, from the axis of W that is not along it.
Vec3 any_side(const Vec3& d) {
  const Vec3 start = std::abs(d.x()) < 0.9 ? Vec3::UnitX() : Vec3::UnitY();
  return (start - start.dot(d) * d).normalized();
}

}  // namespace

Pose own_frame(const ToothFrame& frame, const std::optional<Vec3>& origin,
               const std::optional<double>& turn) {
  if (!frame.occlusal.known())
    throw Error("the tooth's occlusal direction is not known: give it by toothprep orient");
  if (!frame.mesial.known() && !turn)
    throw Error(
        "the tooth's mesial direction is not known: give it by toothprep orient --mesial, or say "
        "how "
        "the path is turned (--turn-deg)");
  if (!frame.fossa && !origin)
    throw Error("no central fossa was found: say where the path's origin lies (--at X,Y,Z)");
  const Vec3& z = frame.occlusal.direction;
  const Vec3 x = frame.mesial.known() ? frame.mesial.direction : any_side(z);
  Mat3 axes;
  axes << x, z.cross(x), z;
  Pose pose{origin ? *origin : *frame.fossa, Quat(axes).normalized()};
  if (turn)
    pose.orientation =
        (pose.orientation * Quat(Eigen::AngleAxisd(*turn, Vec3::UnitZ()))).normalized();
  return pose;
}

Pose operator*(const Pose& a, const Pose& b) {
  return {a.to_world(b.position), (a.orientation * b.orientation).normalized()};
}

Pose inverse(const Pose& pose) {
  const Quat back = pose.orientation.conjugate();
  return {-(back * pose.position), back};
}

Trajectory placed(Trajectory path, const Pose& pose) {
  for (HandleSample& sample : path.samples) {
    sample.pose = pose * sample.pose;
    sample.load = pose.orientation * sample.load;
  }
  for (Vec3& force : path.measured_force) force = pose.orientation * force;
  return path;
}

FittedPlaces fit_places(const std::vector<Vec3>& from, const std::vector<Vec3>& to) {
  if (from.size() != to.size())
    throw Error("there are " + std::to_string(from.size()) + " places of the path and " +
                std::to_string(to.size()) + " of the tooth");
  if (from.size() < 3) throw Error("three places or more are needed");
  const auto n = static_cast<Eigen::Index>(from.size());
  Eigen::Matrix3Xd a(3, n), b(3, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    a.col(i) = from[static_cast<std::size_t>(i)];
    b.col(i) = to[static_cast<std::size_t>(i)];
  }
  for (const Eigen::Matrix3Xd& places : {a, b}) {
    const Eigen::Matrix3Xd off = places.colwise() - places.rowwise().mean();
    const Vec3 spread = off.jacobiSvd().singularValues();
    if (!(spread[1] > 0.05 * spread[0])) throw Error("the places lie on a line");
  }
  const Eigen::Matrix4d motion = Eigen::umeyama(a, b, false);
  FittedPlaces fit;
  fit.pose = {motion.block<3, 1>(0, 3), Quat(Mat3(motion.block<3, 3>(0, 0))).normalized()};
  double sum = 0;
  for (std::size_t i = 0; i < from.size(); ++i) {
    const double off = (fit.pose.to_world(from[i]) - to[i]).norm();
    sum += off * off;
    fit.largest = std::max(fit.largest, off);
  }
  fit.rms = std::sqrt(sum / static_cast<double>(from.size()));
  return fit;
}

bool holds_place_pairs(const std::string& path) {
  const toml::table root = parse_toml(read_small_text(path), path);
  return root.contains("path_mm") || root.contains("tooth_mm");
}

FittedPlaces read_place_pairs(const std::string& path) {
  const toml::table root = parse_toml(read_small_text(path), path);
  StrictTable table(root, path);
  const auto from = table.vectors("path_mm"), to = table.vectors("tooth_mm");
  if (!from) table.missing("path_mm", "[[x, y, z], ...], three places in the path's frame");
  if (!to) table.missing("tooth_mm", "[[x, y, z], ...], the same places on the tooth");
  table.done();
  try {
    return fit_places(*from, *to);
  } catch (const Error& e) {
    throw InputError(path, "", e.what(), "pick three or more places far apart, in the same order");
  }
}

}  // namespace toothprep
