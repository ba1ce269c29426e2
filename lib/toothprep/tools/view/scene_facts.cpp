#include "toothprep/tools/view/scene_facts.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "toothprep/tools/compare/deviation_file.h"
#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/render/colours.h"
#include "toothprep/tools/render/view.h"
#include "toothprep/tools/view/wire.h"

namespace toothprep {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kArcStep = 0.1;  // rad, of an outline's arcs
constexpr int kRampColours = 17;  // as page/surface.js expects

Json numbers(const Vec3& v) { return {v.x(), v.y(), v.z()}; }

Json colour_json(Tissue tissue) {
  const Colour c = tissue_colour(tissue);
  return {c[0], c[1], c[2]};
}

// The head's outline from the tip on, as points r, z in mm.
Json outline_of(const Bur& bur) {
  Json points = Json::array();
  for (const ProfilePiece& piece : bur.profile()) {
    int parts = 1;
    if (piece.kind == ProfilePiece::Kind::kArc)
      parts = 1 + static_cast<int>(std::abs(arc_span(piece).sweep) / kArcStep);
    if (points.empty()) points.push_back({piece.r0, piece.z0});
    for (int i = 1; i <= parts; ++i) {
      const ProfilePoint p = point_on(piece, static_cast<double>(i) / parts);
      points.push_back({p.r, p.z});
    }
  }
  return points;
}

Json bur_json(const Bur& bur) {
  return {{"name", bur.name()},
          {"outline", outline_of(bur)},
          {"head_length", bur.head_length()},
          {"max_radius", bur.max_radius()},
          {"shank_radius", bur.shank_radius()},
          {"shank_top", bur.shank_top()}};
}

Json deviation_json() {
  Json colours = Json::array();
  for (int i = 0; i < kRampColours; ++i) {
    const Colour c = diverging_colour(2.f * static_cast<float>(i) / (kRampColours - 1) - 1);
    colours.push_back({c[0], c[1], c[2]});
  }
  return {{"limit", kDeviationColourLimit}, {"colours", colours}};
}

const char* name_of(SceneKind kind) {
  return kind == SceneKind::kLive ? "live" : kind == SceneKind::kReplay ? "replay" : "surfaces";
}

}  // namespace

std::string scene_json(const SceneFacts& facts) {
  const ToothAxes axes = facts.axes ? *facts.axes : tooth_axes(facts.provenance);
  Json j = {{"kind", name_of(facts.kind)},
            {"version", facts.version},
            {"layers", facts.layers},
            {"bounds", {numbers(facts.bounds.min), numbers(facts.bounds.max)}},
            {"axes",
             {{"occlusal", numbers(axes.occlusal)},
              {"mesial", numbers(axes.mesial)},
              {"buccal", numbers(axes.buccal)}}}};
  j["tissues"] = {{{"name", ""}, {"colour", colour_json(Tissue::kAir)}}};  // by label; 0: unknown
  for (int k = 0; k < kTissueCount; ++k)
    j["tissues"].push_back(
        {{"name", std::string(kTissueNames[k])}, {"colour", colour_json(tissue_at(k))}});
  if (facts.bur) j["bur"] = bur_json(*facts.bur);
  if (facts.parameters) {
    const Handpiece& h = facts.parameters->handpiece;
    j["stall_torque"] = std::isfinite(h.stall_torque) ? Json(h.stall_torque) : Json(nullptr);
    j["rotation_rate"] = h.rotation_rate;
    j["time_step"] = facts.parameters->time_step;
  }
  j["columns"] = row_columns(facts.mirror);
  j["rows"] = facts.rows;
  j["other_rows"] = facts.other_rows;
  j["stride"] = facts.stride;
  j["session"] = facts.session;
  j["control"] = facts.control;
  if (facts.deviation) j["deviation"] = deviation_json();
  j["burs"] = Json::array();
  for (const Bur* bur : facts.burs) j["burs"].push_back(bur_json(*bur));
  j["events"] = Json::array();
  for (const SessionEvent& e : facts.events)
    j["events"].push_back({{"time", e.time}, {"kind", name_of(e.kind)}, {"bur", e.arguments[0]}});
  if (facts.volume)
    j["volume"] = {
        {"counts", {facts.volume->counts.x(), facts.volume->counts.y(), facts.volume->counts.z()}},
        {"origin", numbers(facts.volume->origin)},
        {"spacing", facts.volume->spacing}};
  return json_text(j);
}

}  // namespace toothprep
