#include "toothprep/tools/view/wire.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <utility>

#include "toothprep/tools/compare/deviation_file.h"
#include "toothprep/tools/render/mesh_normals.h"

namespace toothprep {
namespace {

static_assert(std::endian::native == std::endian::little, "the page reads little-endian numbers");

constexpr int kSmoothing = 3;  // as pictures have (render/part.h)

void append_floats(const Vec3& v, std::string& bytes) {
  for (int i = 0; i < 3; ++i) append_bytes(static_cast<float>(v[i]), bytes);
}
void append_floats(const Quat& q, std::string& bytes) {
  for (int i = 0; i < 4; ++i) append_bytes(static_cast<float>(q.coeffs()[i]), bytes);
}
void append_floats(const PerTissue<double>& values, std::string& bytes) {
  for (const double v : values) append_bytes(static_cast<float>(v), bytes);
}
template <class T>
void append_floats(T value, std::string& bytes) {
  append_bytes(static_cast<float>(value), bytes);
}

void append_normal(const Eigen::Vector3f& normal, std::int16_t code, std::string& bytes) {
  for (int i = 0; i < 3; ++i)
    append_bytes(static_cast<std::int16_t>(std::lround(32767 * normal[i])), bytes);
  append_bytes(code, bytes);
}

void append_head(const Index3& block, std::size_t vertices, std::size_t triangles,
                 std::string& bytes) {
  for (int i = 0; i < 3; ++i) append_bytes(static_cast<std::int32_t>(block[i]), bytes);
  append_bytes(static_cast<std::int32_t>(vertices), bytes);
  append_bytes(static_cast<std::int32_t>(triangles), bytes);
}

}  // namespace

BlockBytes::BlockBytes(std::int32_t frame) {
  append_bytes(frame, bytes_);
  append_bytes(std::int32_t{0}, bytes_);
}

void BlockBytes::add(const BlockMesh& block) {
  const DisplayMesh& mesh = block.mesh;
  bytes_.reserve(bytes_.size() + 20 + 20 * mesh.vertices.size() + 12 * mesh.triangles.size());
  append_head(block.block, mesh.vertices.size(), mesh.triangles.size(), bytes_);
  for (const auto& vertex : mesh.vertices)
    for (int i = 0; i < 3; ++i) append_bytes(vertex[i], bytes_);
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v)
    append_normal(mesh.normals[v], mesh.tissue[v], bytes_);
  for (const auto& triangle : mesh.triangles) append_bytes(triangle, bytes_);
  ++blocks_;
}

void BlockBytes::add(const TriangleMesh& mesh, const std::vector<float>& deviation) {
  const std::vector<Eigen::Vector3f> normals = corner_normals(mesh, kSmoothing);
  append_head(Index3::Zero(), normals.size(), mesh.triangles.size(), bytes_);
  for (const auto& triangle : mesh.triangles)
    for (const std::uint32_t v : triangle)
      for (int i = 0; i < 3; ++i) append_bytes(mesh.vertices[v][i], bytes_);
  for (std::size_t corner = 0; corner < normals.size(); ++corner) {
    const std::uint32_t v = mesh.triangles[corner / 3][corner % 3];
    append_normal(normals[corner],
                  vertex_code(mesh.tissue.empty() ? 0 : mesh.tissue[v],
                              deviation.empty() ? NAN : deviation[v]),
                  bytes_);
  }
  for (std::uint32_t corner = 0; corner < normals.size(); ++corner) append_bytes(corner, bytes_);
  ++blocks_;
}

std::string BlockBytes::take() {
  std::memcpy(bytes_.data() + sizeof(std::int32_t), &blocks_, sizeof(blocks_));
  return std::move(bytes_);
}

std::int16_t vertex_code(std::uint8_t tissue, float deviation_mm) {
  if (!std::isfinite(deviation_mm)) return tissue;
  const double share = std::clamp(deviation_mm / kDeviationColourLimit, -1.0, 1.0);
  return static_cast<std::int16_t>(tissue + 8 * (2048 + std::lround(2047 * share)));
}

std::vector<std::string_view> row_columns(bool mirror) {
  std::vector<std::string_view> names = {
      "bur_x",          "bur_y",        "bur_z",         "bur_qx",     "bur_qy",
      "bur_qz",         "bur_qw",       "handle_x",      "handle_y",   "handle_z",
      "handle_qx",      "handle_qy",    "handle_qz",     "handle_qw",  "force_x",
      "force_y",        "force_z",      "grinding_x",    "grinding_y", "grinding_z",
      "torque",         "torque_trial", "rotation_rate", "stalled",    "area_enamel",
      "area_dentin",    "area_pulp",    "area_other",    "shank_area", "removed_enamel",
      "removed_dentin", "removed_pulp", "removed_other", "rejected",   "flags",
      "fault",          "missed"};
  if (mirror)
    for (const char* name :
         {"mirror_x", "mirror_y", "mirror_z", "mirror_qx", "mirror_qy", "mirror_qz", "mirror_qw"})
      names.emplace_back(name);
  return names;
}

void append_row(const ViewRow& row, std::string& bytes) {
  const StepRecord& s = *row.step;
  append_floats(s.bur.position, bytes);
  append_floats(s.bur.orientation, bytes);
  append_floats(s.handle.pose.position, bytes);
  append_floats(s.handle.pose.orientation, bytes);
  append_floats(s.device_force, bytes);
  append_floats(s.grinding_force, bytes);
  append_floats(s.torque, bytes);
  append_floats(s.torque_trial, bytes);
  append_floats(s.rotation_rate, bytes);
  append_floats(s.stalled, bytes);
  append_floats(s.contact_area, bytes);
  append_floats(s.shank_contact_area, bytes);
  append_floats(s.removed_volume, bytes);
  append_floats(s.handle.rejected, bytes);
  append_floats(row.flags, bytes);
  append_floats(row.fault, bytes);
  append_floats(row.missed, bytes);
  if (!row.mirror) return;
  append_floats(row.mirror->position, bytes);
  append_floats(row.mirror->orientation, bytes);
}

}  // namespace toothprep
