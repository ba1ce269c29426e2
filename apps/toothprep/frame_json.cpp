#include "frame_json.h"

namespace toothprep::app {
namespace {

using Json = nlohmann::ordered_json;

Json list(const Vec3& v) { return {v.x(), v.y(), v.z()}; }

void put(Json& json, const std::string& key, const FrameAxis& axis) {
  json[key] = axis.known() ? list(axis.direction) : Json(nullptr);
  if (axis.known()) json[key + "_uncertainty_deg"] = axis.uncertainty_deg;
  json[key + "_source"] = std::string(name_of(axis.source));
}

void put(Json& json, const std::string& key, const std::optional<FramePlane>& plane) {
  if (!plane) return;
  json[key + "_mm"] = list(plane->point);
  json[key + "_normal"] = list(plane->normal);
}

}  // namespace

void put_frame(Json& json, const std::string& prefix, const ToothFrame& frame) {
  const auto places = [&](const char* key, const std::vector<Vec3>& points) {
    if (points.empty()) return;
    Json all = Json::array();
    for (const Vec3& x : points) all.push_back(list(x));
    json[prefix + key] = std::move(all);
  };
  put(json, prefix + "occlusal", frame.occlusal);
  put(json, prefix + "mesial", frame.mesial);
  put(json, prefix + "buccal", frame.buccal);
  put(json, prefix + "long_axis", frame.long_axis);
  if (frame.fossa) json[prefix + "fossa_mm"] = list(*frame.fossa);
  places("cusps_mm", frame.cusps);
  put(json, prefix + "cervical", frame.cervical);
  places("cervical_line_mm", frame.cervical_line);
  put(json, prefix + "occlusal_plane", frame.occlusal_plane);
  json[prefix + "form"] = std::string(name_of(frame.form));
  if (frame.tooth_number) json[prefix + "tooth_number"] = *frame.tooth_number;
}

}  // namespace toothprep::app
