#include "toothprep/tools/files/cut_way_text.h"

#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/core/errors.h"

namespace toothprep {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::array kWayColumns = {"x_mm",     "y_mm",    "z_mm",     "qx",       "qy",
                                    "qz",       "qw",      "way_x_mm", "way_y_mm", "way_z_mm",
                                    "aside_mm", "goes_on", "head"};
constexpr std::size_t kMostParts = std::size_t{1} << 20, kMostHeads = 4096;
constexpr double kFarthestPart = 1e4;     // mm, of a part from the origin, and its length
constexpr double kUnitQuaternion = 1e-6;  // of its square

StraightPart part_of_row(const Json& row, std::size_t number, std::size_t heads) {
  const auto refuse = [&](const std::string& condition) {
    throw Error("part " + std::to_string(number + 1) + " " + condition);
  };
  if (!row.is_array() || row.size() != kWayColumns.size())
    refuse("isn't " + std::to_string(kWayColumns.size()) + " numbers");
  std::array<double, kWayColumns.size()> v;
  for (std::size_t k = 0; k < v.size(); ++k) {
    if (!row[k].is_number()) refuse("isn't " + std::to_string(kWayColumns.size()) + " numbers");
    v[k] = row[k].get<double>();
    if (!(std::abs(v[k]) <= kFarthestPart)) refuse("holds a number beyond 1e4");
  }
  StraightPart part;
  part.from.position = Vec3(v[0], v[1], v[2]);
  part.from.orientation = Quat(v[6], v[3], v[4], v[5]);
  part.way = Vec3(v[7], v[8], v[9]);
  part.aside = v[10];
  part.goes_on = v[11] != 0;
  if (!(v[12] >= 0 && v[12] < static_cast<double>(heads) && v[12] == std::floor(v[12])))
    refuse("has no head of the list");
  part.head = static_cast<int>(v[12]);
  if (!(std::abs(part.from.orientation.squaredNorm() - 1) <= kUnitQuaternion))
    refuse("has an orientation that is no unit quaternion");
  if (part.aside < 0) refuse("has a negative aside_mm");
  return part;
}

}  // namespace

std::string cut_way_text(const CutWay& way) {
  Json rows = Json::array();
  for (const StraightPart& p : way.parts) {
    const Vec3& x = p.from.position;
    const Quat& q = p.from.orientation;
    rows.push_back({x.x(), x.y(), x.z(), q.x(), q.y(), q.z(), q.w(), p.way.x(), p.way.y(),
                    p.way.z(), p.aside, p.goes_on ? 1 : 0, p.head});
  }
  return Json{{"heads", way.heads}, {"columns", kWayColumns}, {"parts", std::move(rows)}}.dump();
}

CutWay parse_cut_way(const std::string& text) {
  const Json json = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object() || !json.contains("heads") || !json["heads"].is_array() ||
      !json.contains("columns") || !json.contains("parts") || !json["parts"].is_array())
    throw Error("isn't JSON with heads, columns and parts");
  if (json["columns"] != Json(kWayColumns)) throw Error("has other columns than are known");
  const Json& rows = json["parts"];
  if (rows.size() > kMostParts) throw Error("has more than 2^20 parts");
  CutWay way;
  if (json["heads"].size() > kMostHeads) throw Error("has more than 4096 heads");
  for (const Json& head : json["heads"]) {
    if (!head.is_string()) throw Error("has a head that isn't text");
    way.heads.push_back(head.get<std::string>());
    const Bur checked("head of the bur's way", outline_of(way.heads.back()), 0, 0);
  }
  for (const Json& row : rows)
    way.parts.push_back(part_of_row(row, way.parts.size(), way.heads.size()));
  return way;
}

}  // namespace toothprep
