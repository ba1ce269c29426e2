#include "toothprep/tools/view/scene_facts.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/render/colours.h"
#include "toothprep/tools/render/view.h"
#include "toothprep/tools/view/wire.h"

namespace toothprep {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kArcStep = 0.1;  // rad, of an outline's arcs

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

const char* name_of(SceneKind kind) {
  return kind == SceneKind::kLive ? "live" : kind == SceneKind::kReplay ? "replay" : "surfaces";
}

}  // namespace

std::string scene_json(const SceneFacts& facts) {
  const ToothAxes axes = tooth_axes(facts.provenance);
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
  j["columns"] = row_columns();
  j["rows"] = facts.rows;
  j["stride"] = facts.stride;
  j["session"] = facts.session;
  if (facts.volume)
    j["volume"] = {
        {"counts", {facts.volume->counts.x(), facts.volume->counts.y(), facts.volume->counts.z()}},
        {"origin", numbers(facts.volume->origin)},
        {"spacing", facts.volume->spacing}};
  return json_text(j);
}

}  // namespace toothprep
