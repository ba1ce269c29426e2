#include "toothprep/tools/orientation/tooth_frame.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <locale>
#include <sstream>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/number_text.h"
#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

using Texts = std::map<std::string, std::string>;

constexpr std::array<std::string_view, 5> kSources = {"not known", "estimated", "landmarks",
                                                      "recorded", "given"};
constexpr std::array<std::string_view, 4> kForms = {"not known", "incisor", "premolar", "molar"};
constexpr std::array<const char*, 4> kAxes = {"occlusal", "mesial", "buccal", "long"};

const FrameAxis& axis_of(const ToothFrame& frame, std::size_t n) {
  return n == 0 ? frame.occlusal : n == 1 ? frame.mesial : n == 2 ? frame.buccal : frame.long_axis;
}

std::string vector_text(const Vec3& v) {
  return shortest_text(v.x()) + " " + shortest_text(v.y()) + " " + shortest_text(v.z());
}

// Six digits: a nanometre, and 0.1 µm of a millimetre.
std::string rounded_text(const Vec3& v) {
  return fmt::format("{:.6f} {:.6f} {:.6f}", v.x() + 0.0, v.y() + 0.0, v.z() + 0.0);
}

std::vector<Vec3> vectors_of(const Texts& texts, const std::string& key) {
  std::vector<Vec3> vectors;
  const auto found = texts.find(key);
  if (found == texts.end()) return vectors;
  std::istringstream lines(found->second);
  for (std::string line; std::getline(lines, line, ';');) {
    for (char& c : line)
      if (c == ',') c = ' ';
    std::istringstream text(line);
    text.imbue(std::locale::classic());
    Vec3 v;
    std::string rest;
    if (!(text >> v.x() >> v.y() >> v.z()) || text >> rest || !v.allFinite())
      throw Error(key + ": '" + found->second.substr(0, 60) + "' is not 'x y z'");
    vectors.push_back(v);
  }
  return vectors;
}

std::optional<Vec3> vector_of(const Texts& texts, const std::string& key) {
  const std::vector<Vec3> vectors = vectors_of(texts, key);
  if (vectors.size() > 1) throw Error(key + ": holds more than one place");
  return vectors.empty() ? std::nullopt : std::optional(vectors[0]);
}

std::optional<Vec3> direction_of(const Texts& texts, const std::string& key) {
  const auto v = vector_of(texts, key);
  if (!v) return {};
  if (v->stableNorm() < 1e-9) throw Error(key + ": the direction is zero");
  return v->stableNormalized();
}

// "occlusal 4.2 estimated; mesial not known; ...": of one axis.
FrameAxis confidence_of(const std::string& text, const std::string& name, const Vec3& direction) {
  std::istringstream parts(text);
  for (std::string part; std::getline(parts, part, ';');) {
    std::istringstream words(part);
    words.imbue(std::locale::classic());
    std::string axis, source;
    double degrees = 0;
    if (!(words >> axis) || axis != name) continue;
    if (!(words >> degrees >> source) || !(degrees >= 0 && degrees <= 180)) break;
    for (std::size_t s = 1; s < kSources.size(); ++s)
      if (source == kSources[s]) return {direction, degrees, static_cast<AxisSource>(s)};
    break;
  }
  throw Error("frame_confidence: '" + text.substr(0, 80) + "' doesn't say how well frame_" + name +
              " is known");
}

std::optional<FramePlane> plane_of(const Texts& texts, const std::string& key) {
  const auto point = vector_of(texts, key + "_mm");
  const auto normal = direction_of(texts, key + "_normal");
  return point && normal ? std::optional(FramePlane{*point, *normal}) : std::nullopt;
}

// Across the occlusal axis.
void square(FrameAxis& axis, const ToothFrame& frame, const std::string& name) {
  if (!axis.known() || !frame.occlusal.known()) return;
  const Vec3& d = frame.occlusal.direction;
  const Vec3 flat = axis.direction - axis.direction.dot(d) * d;
  if (flat.norm() < 0.02) throw Error(name + " is parallel to the occlusal axis");
  axis.direction = flat.normalized();
}

}  // namespace

std::string_view name_of(AxisSource source) noexcept {
  return kSources[static_cast<std::size_t>(source)];
}
std::string_view name_of(CrownForm form) noexcept { return kForms[static_cast<std::size_t>(form)]; }

ToothFrame recorded_frame(const Texts& texts) {
  ToothFrame frame;
  const auto confidence = texts.find("frame_confidence");
  const auto read = [&](const std::string& name, FrameAxis& axis) {
    if (confidence != texts.end()) {
      if (const auto v = direction_of(texts, "frame_" + name))
        axis = confidence_of(confidence->second, name, *v);
    } else if (const auto exact = direction_of(texts, "axis_" + name)) {
      axis = {*exact, 0, AxisSource::kRecorded};
    }
  };
  read("occlusal", frame.occlusal);
  read("mesial", frame.mesial);
  read("buccal", frame.buccal);
  read("long", frame.long_axis);
  square(frame.mesial, frame, "the mesial direction");
  square(frame.buccal, frame, "the buccal direction");
  if (frame.mesial.known() && frame.buccal.known() &&
      std::abs(frame.mesial.direction.dot(frame.buccal.direction)) > 0.94)
    throw Error("the mesial and the buccal direction are parallel");
  frame.fossa = vector_of(texts, "frame_fossa_mm");
  const auto fossa_source = texts.find("frame_fossa_source");
  frame.fossa_picked =
      fossa_source != texts.end() && fossa_source->second == name_of(AxisSource::kLandmarks);
  frame.cusps = vectors_of(texts, "frame_cusps_mm");
  frame.cervical = plane_of(texts, "frame_cervical");
  frame.occlusal_plane = plane_of(texts, "frame_occlusal_plane");
  if (const auto form = texts.find("frame_form"); form != texts.end())
    for (std::size_t f = 1; f < kForms.size(); ++f)
      if (form->second == kForms[f]) frame.form = static_cast<CrownForm>(f);
  if (const auto number = texts.find("frame_tooth_number"); number != texts.end())
    frame.tooth_number = std::atoi(number->second.c_str());
  return frame;
}

void record_frame(const ToothFrame& frame, Texts& texts) {
  std::erase_if(texts, [](const auto& entry) { return entry.first.starts_with("frame_"); });
  std::string confidence;
  for (std::size_t n = 0; n < kAxes.size(); ++n) {
    const FrameAxis& axis = axis_of(frame, n);
    confidence += (n ? "; " : "") + std::string(kAxes[n]) + " ";
    if (axis.known()) {
      texts[std::string("frame_") + kAxes[n]] = vector_text(axis.direction);
      confidence +=
          fmt::format("{:.1f} {}", std::ceil(10 * axis.uncertainty_deg) / 10, name_of(axis.source));
    } else {
      confidence += "not known";
    }
  }
  texts["frame_confidence"] = confidence;
  const auto plane = [&](const std::string& key, const std::optional<FramePlane>& p) {
    if (!p) return;
    texts[key + "_mm"] = rounded_text(p->point);
    texts[key + "_normal"] = rounded_text(p->normal);
  };
  if (frame.fossa) texts["frame_fossa_mm"] = rounded_text(*frame.fossa);
  if (frame.fossa_picked) texts["frame_fossa_source"] = name_of(AxisSource::kLandmarks);
  std::string cusps;
  for (const Vec3& tip : frame.cusps) cusps += (cusps.empty() ? "" : "; ") + rounded_text(tip);
  if (!cusps.empty()) texts["frame_cusps_mm"] = cusps;
  plane("frame_cervical", frame.cervical);
  plane("frame_occlusal_plane", frame.occlusal_plane);
  if (frame.form != CrownForm::kNotKnown) texts["frame_form"] = std::string(name_of(frame.form));
  if (frame.tooth_number) texts["frame_tooth_number"] = std::to_string(*frame.tooth_number);
}

std::string frame_text(const ToothFrame& frame) {
  std::string text;
  for (std::size_t n = 0; n < 3; ++n) {
    const FrameAxis& axis = axis_of(frame, n);
    text += (n ? "; " : "") + std::string(kAxes[n]) + " ";
    if (axis.known())
      text += fmt::format("{:.2f} {:.2f} {:.2f} (\u00b1{:.1f} degrees, {})",
                          axis.direction.x() + 0.0, axis.direction.y() + 0.0,
                          axis.direction.z() + 0.0, axis.uncertainty_deg, name_of(axis.source));
    else
      text += "not known";
  }
  return text;
}

}  // namespace toothprep
