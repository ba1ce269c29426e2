#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/strict_toml.h"
#include "toothprep/tools/recordings/import_recording.h"

namespace toothprep {
namespace {

constexpr double kNotUnit = 1e-3;

Pose pose_of_matrix(const StrictTable& table, const toml::table& root) {
  const toml::array* rows = root["matrix"].as_array();
  if (!rows || (rows->size() != 3 && rows->size() != 4))
    table.refuse("matrix", "must be 3 or 4 rows of 4 numbers");
  Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
  for (std::size_t i = 0; i < rows->size(); ++i) {
    const toml::array* row = rows->get(i)->as_array();
    if (!row || row->size() != 4) table.refuse("matrix", "must be 3 or 4 rows of 4 numbers");
    for (std::size_t j = 0; j < 4; ++j) {
      const auto value = row->get(j)->value<double>();
      if (!value || !std::isfinite(*value)) table.refuse("matrix", "must be finite numbers");
      m(static_cast<int>(i), static_cast<int>(j)) = *value;
    }
  }
  const Mat3 turn = m.topLeftCorner<3, 3>();
  if (m.row(3) != Eigen::RowVector4d(0, 0, 0, 1))
    table.refuse("matrix", "must end with 0, 0, 0, 1");
  if ((turn.transpose() * turn - Mat3::Identity()).cwiseAbs().maxCoeff() > kNotUnit)
    table.refuse("matrix", "must be a rotation beside a translation, without a scale");
  if (turn.determinant() < 0) table.refuse("matrix", "mirrors; a rotation has determinant 1");
  return {m.topRightCorner<3, 1>(), Quat(turn).normalized()};
}

}  // namespace

Pose read_rigid_transform(const std::string& path) {
  toml::table root = parse_toml(read_small_text(path), path);
  if (root.contains("matrix")) {
    Pose pose = pose_of_matrix(StrictTable(root, path), root);
    root.erase("matrix");
    if (!root.empty())
      throw InputError(path, std::string(root.begin()->first.str()), "stands beside matrix",
                       "a matrix says it all: leave the other out");
    return pose;
  }
  StrictTable table(root, path);
  Pose pose;
  if (const auto q = table.numbers("rotation_xyzw")) {
    if (q->size() != 4) table.refuse("rotation_xyzw", "must be four numbers [x, y, z, w]");
    if (!accept_quaternion(Quat((*q)[3], (*q)[0], (*q)[1], (*q)[2]), pose.orientation))
      table.refuse("rotation_xyzw", "must be of length 1");
  }
  if (const auto t = table.vector("translation_mm")) pose.position = *t;
  table.done({"matrix"});
  return pose;
}

}  // namespace toothprep
