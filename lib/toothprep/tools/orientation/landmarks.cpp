#include "toothprep/tools/orientation/landmarks.h"

#include <Eigen/Dense>
#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/strict_toml.h"
#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

FrameAxis axis_between(StrictTable& table, const std::string& key, const Vec3& from, const Vec3& to,
                       double uncertainty) {
  const double distance = (to - from).norm();
  if (distance < 3 * uncertainty)
    table.refuse(key, "lies too near to the place opposite to give a direction",
                 "pick places further apart than three times uncertainty_mm");
  return {(to - from) / distance,
          units::to_degree(std::atan(std::sqrt(2.0) * uncertainty / distance)),
          AxisSource::kLandmarks};
}

// From one side to the other, or from the middle to one side.
FrameAxis side(StrictTable& table, const std::string& to_key, const std::string& from_key,
               const std::optional<Vec3>& middle, double uncertainty) {
  const auto to = table.vector(to_key), from = table.vector(from_key);
  if (!to && !from) return {};
  if (to && from) return axis_between(table, to_key, *from, *to, uncertainty);
  const std::string& key = to ? to_key : from_key;
  if (!middle)
    table.refuse(key, "needs a second place", "add " + (to ? from_key : to_key) + " or middle_mm");
  return to ? axis_between(table, key, *middle, *to, uncertainty)
            : axis_between(table, key, *from, *middle, uncertainty);
}

// Normal of the plane through places, to the side away from `below`.
FrameAxis plane_normal(StrictTable& table, const std::vector<Vec3>& places, const Vec3& below,
                       double uncertainty) {
  if (places.size() < 3) table.refuse("occlusal_mm", "needs three places or more");
  Vec3 middle = Vec3::Zero();
  for (const Vec3& x : places) middle += x;
  const auto count = static_cast<double>(places.size());
  middle /= count;
  Mat3 spread = Mat3::Zero();
  for (const Vec3& x : places) spread += (x - middle) * (x - middle).transpose();
  const Eigen::SelfAdjointEigenSolver<Mat3> solver(spread / count);
  const double narrow = std::sqrt(std::max(0.0, solver.eigenvalues()[1]));
  if (narrow < uncertainty) table.refuse("occlusal_mm", "the places lie on a line");
  Vec3 normal = solver.eigenvectors().col(0);
  const double height = normal.dot(middle - below);
  if (std::abs(height) < 3 * uncertainty)
    table.refuse("apical_mm", "lies in the occlusal plane, so it doesn't say which side is up");
  if (height < 0) normal = -normal;
  return {normal, units::to_degree(std::atan(uncertainty / (narrow * std::sqrt(count)))),
          AxisSource::kLandmarks};
}

}  // namespace

KnownAxes parse_landmarks(const std::string& toml, const std::string& where) {
  const toml::table root = parse_toml(toml, where);
  StrictTable table(root, where);
  KnownAxes known;
  const double uncertainty = table.number("uncertainty_mm").value_or(0.3);
  if (!(uncertainty > 0 && uncertainty < 10))
    table.refuse("uncertainty_mm", "must lie between 0 and 10");
  const auto middle = table.vector("middle_mm"), apical = table.vector("apical_mm"),
             crown = table.vector("crown_mm");
  const auto occlusal = table.vectors("occlusal_mm");
  if (occlusal) {
    const auto below = apical ? apical : middle;
    if (!below) table.missing("apical_mm", "[x, y, z], a place at the root's end");
    known.occlusal = plane_normal(table, *occlusal, *below, uncertainty);
  } else if (apical && crown) {
    known.occlusal = axis_between(table, "crown_mm", *apical, *crown, uncertainty);
  } else if (apical || crown) {
    table.refuse(apical ? "apical_mm" : "crown_mm", "gives no direction by itself",
                 "add occlusal_mm, or both apical_mm and crown_mm");
  }
  known.mesial = side(table, "mesial_mm", "distal_mm", middle, uncertainty);
  known.buccal = side(table, "buccal_mm", "lingual_mm", middle, uncertainty);
  known.fossa = table.vector("fossa_mm");
  if (const auto number = table.integer("tooth_number")) {
    if (*number < 11 || *number > 85) table.refuse("tooth_number", "must be a tooth number of FDI");
    known.tooth_number = static_cast<int>(*number);
  }
  table.done();
  if (!known.occlusal.known() && !known.mesial.known() && !known.buccal.known() && !known.fossa &&
      !known.tooth_number)
    throw InputError(where, "", "gives neither a direction nor a fossa",
                     "add occlusal_mm and apical_mm, or mesial_mm and distal_mm");
  return known;
}

KnownAxes read_landmarks(const std::string& path) {
  return parse_landmarks(read_small_text(path), path);
}

}  // namespace toothprep
