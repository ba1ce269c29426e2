#include "placing.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "strictness.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/files/tooth_file.h"
#include "toothprep/tools/live/registration.h"
#include "toothprep/tools/orientation/estimate_frame.h"
#include "toothprep/tools/orientation/landmarks.h"

namespace toothprep::app {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kThinDentin = 0.5;  // mm over the pulp: less is warned of

// "X,Y,Z", or nothing.
std::optional<Vec3> place_of(const std::string& text) {
  Vec3 v;
  int used = 0;
  if (std::sscanf(text.c_str(), "%lf , %lf , %lf %n", &v.x(), &v.y(), &v.z(), &used) != 3 ||
      static_cast<std::size_t>(used) != text.size() || !v.allFinite())
    return {};
  return v;
}

PlacedPath by_registration(Trajectory path, const std::string& file) {
  const Registration r = read_registration(file);
  if (!r.translation)
    throw InputError(file, "translation_mm", "is missing",
                     "a recorded path needs it: add translation_mm = [x, y, z]");
  const HandleFrame frame(r, Vec3::Zero(), Vec3::Zero());
  for (HandleSample& s : path.samples) {
    s.pose = frame.to_world(s.pose.position, s.pose.orientation);
    s.load = r.rotation * s.load;
  }
  for (Vec3& force : path.measured_force) force = r.rotation * force;
  return {std::move(path), "by the registration " + file, {}};
}

PlacedPath by_pairs(Trajectory path, const std::string& file) {
  const FittedPlaces fit = read_place_pairs(file);
  PlacedPath result{placed(std::move(path), fit.pose),
                    fmt::format("fitted to the places of {}: {:.3f} mm rms, {:.3f} mm at most",
                                file, fit.rms, fit.largest),
                    {}};
  if (fit.rms > 0.5)
    result.notes.push_back(
        fmt::format("{}: the places are {:.2f} mm apart (rms) after the fit: a pair may be wrong",
                    file, fit.rms));
  return result;
}

bool odd_quadrant(int number) { return (number / 10) % 2 == 1; }

enum class At { kFossa, kPlace, kLandmarks, kPairs };  // what --at names

At at_of(const PlacingOptions& o) {
  if (o.at.empty() || o.at == "fossa") return At::kFossa;
  if (!o.at.ends_with(".toml")) return At::kPlace;
  return holds_place_pairs(o.at) ? At::kPairs : At::kLandmarks;
}

// The file's name in front of what isn't known of its tooth.
template <class Work>
auto naming(const std::string& file, Work work) {
  try {
    return work();
  } catch (const InputError&) {
    throw;
  } catch (const Error& e) {
    throw InputError(file, "", e.what());
  }
}

}  // namespace

ToothFrame frame_of(const LayeredTooth& tooth) {
  ToothFrame frame = recorded_frame(tooth.provenance);
  const bool complete = tooth.provenance.count("frame_confidence") > 0 && frame.fossa;
  return complete ? frame : estimate_frame(tooth, known_axes(frame));
}

ToothFrame frame_of(const LayeredTooth& tooth, const PlacingOptions& o) {
  if (at_of(o) != At::kLandmarks) return frame_of(tooth);
  return estimate_frame(tooth,
                        both(read_landmarks(o.at), known_axes(recorded_frame(tooth.provenance))));
}

PlacedPath place_path(Trajectory path, PathFrame frame, const std::string& file,
                      const PlacingOptions& o, const LayeredTooth& tooth) {
  const At at = at_of(o);
  const bool pairs = at == At::kPairs;
  if (frame == PathFrame::kTooth && (!o.registration.empty() || pairs))
    throw InputError(file, "frame", "the script is written in the tooth's own frame",
                     "leave out --registration and pairs of places");
  if (!o.registration.empty()) return by_registration(std::move(path), o.registration);
  if (pairs) return by_pairs(std::move(path), o.at);
  const bool other = !o.from.empty() && o.from != "tooth";
  if (frame == PathFrame::kFile && o.from.empty())
    throw InputError(file, "", "is written in a frame that isn't known",
                     "say which: its own tooth's file, 'tooth' for the tooth's own frame, "
                     "--registration, or --at with pairs of places");
  if (frame == PathFrame::kTooth && other)
    throw InputError(file, "frame", "the script is written in the tooth's own frame",
                     "leave out the other tooth's file");
  std::optional<Vec3> origin;
  if (at == At::kPlace) {
    origin = place_of(o.at);
    if (!origin)
      throw InputError(
          "--at", o.at,
          "is neither 'fossa' nor X,Y,Z nor a .toml with landmarks or pairs of places");
  }
  std::optional<double> turn;
  if (o.turn_deg) turn = units::from_degree(*o.turn_deg);
  const ToothFrame here = frame_of(tooth, o);
  const Pose to = own_frame(here, origin, turn);
  PlacedPath result;
  if (!other) {
    result.path = placed(std::move(path), to);
    result.how = "in the tooth's own frame";
    return result;
  }
  const LayeredTooth its_own = with_others_as_other(load_tooth(o.from, false));
  const ToothFrame there = frame_of(its_own);
  const Pose from = naming(o.from, [&] { return own_frame(there); });
  result.path = placed(std::move(path), to * inverse(from));
  result.how = "from the frame of " + o.from;
  if (here.tooth_number && there.tooth_number &&
      odd_quadrant(*here.tooth_number) != odd_quadrant(*there.tooth_number))
    result.notes.push_back(fmt::format(
        "{} is a tooth of the other side ({}, this is {}): its path would have to be mirrored",
        o.from, *there.tooth_number, *here.tooth_number));
  return result;
}

Pose upright_frame(const ToothFrame& frame, const LayeredTooth& tooth) {
  const Box box = bounds_of_solid(tooth);
  return own_frame(frame, frame.fossa ? *frame.fossa : Vec3(0.5 * (box.min + box.max)),
                   frame.mesial.known() ? std::nullopt : std::optional(0.0));
}

void add_placing_options(CLI::App& sub, PlacingOptions& o, const std::string& from_option) {
  sub.add_option(from_option, o.from,
                 "In which frame the path is written: 'tooth' (the tooth's own: central fossa, z\n"
                 "occlusal, x mesial), or the file of the tooth that it was made on (.vdb). A\n"
                 "script with frame = \"tooth\" says so itself");
  sub.add_option(
      "--at", o.at,
      "Where the path's tooth frame has its origin: fossa (default), a place X,Y,Z (mm), the\n"
      "landmarks of this tooth (.toml, as of orient), or pairs of places that the path is\n"
      "fitted to (.toml)");
  sub.add_option("--turn-deg", o.turn_deg, "Turn the path about the occlusal axis at that place");
  sub.add_option("--registration", o.registration,
                 "The path's frame to the tooth's file (.toml, as of live; data/rig/FORMATS.md)");
}

Json path_json(const PathCheck& c, const LayeredTooth& whole) {
  const auto optional = [](const std::optional<double>& v) { return v ? Json(*v) : Json(nullptr); };
  const auto vector = [](const Vec3& v) { return Json{v.x(), v.y(), v.z()}; };
  Json j;
  j["clearance_at_start_mm"] = c.clearance_at_start;
  j["least_distance_mm"] = c.least_distance;
  for (int k = 0; k < kTissueCount; ++k)
    j["removed_mm3"][std::string(kTissueNames[k])] = c.removed[k];
  j["deepest_below_surface_mm"] = c.deepest_below_surface;
  j["deepest_below_dentin_mm"] = c.deepest_below_dentin;
  j["least_to_pulp_mm"] = optional(c.least_to_pulp);
  j["least_to_pulp_at_mm"] = c.least_to_pulp ? vector(c.least_to_pulp_at) : Json(nullptr);
  j["least_to_pulp_time_s"] = c.least_to_pulp ? Json(c.least_to_pulp_time) : Json(nullptr);
  j["least_to_other_mm"] = optional(c.least_to_other);
  j["least_to_other_at_mm"] = c.least_to_other ? vector(c.least_to_other_at) : Json(nullptr);
  j["least_to_other_time_s"] = c.least_to_other ? Json(c.least_to_other_time) : Json(nullptr);
  j["nearest_other"] = c.least_to_other ? Json(body_at(whole, c.least_to_other_at)) : Json(nullptr);
  j["shank_overlap_mm3"] = c.shank_overlap;
  j["shank_time_s"] = c.shank_overlap > 0 ? Json(c.shank_time) : Json(nullptr);
  j["tips_mm"] = {vector(c.tips.min), vector(c.tips.max)};
  j["places"] = Json::array();
  for (const PathPlace& p : c.places)
    j["places"].push_back({{"time_s", p.time},
                           {"tip_mm", vector(p.tip)},
                           {"below_surface_mm", optional(p.below_surface)},
                           {"below_dentin_mm", optional(p.below_dentin)},
                           {"to_dentin_mm", optional(p.to_dentin)},
                           {"to_pulp_mm", optional(p.to_pulp)}});
  return j;
}

std::vector<std::string> path_lines(const PathCheck& c, const LayeredTooth& whole) {
  std::vector<std::string> lines;
  lines.push_back(fmt::format("  start     {:.2f} mm from the tooth", c.clearance_at_start));
  std::string takes;
  for (int k = 0; k < kTissueCount; ++k)
    if (c.removed[k] > 0)
      takes +=
          fmt::format("{}{} {:.2f} mm3", takes.empty() ? "" : ", ", kTissueNames[k], c.removed[k]);
  lines.push_back("  takes     " + (takes.empty() ? "nothing" : takes));
  lines.push_back(
      fmt::format("  depth     {:.2f} mm below the surface, {:.2f} mm below the border of "
                  "enamel and dentin",
                  c.deepest_below_surface, c.deepest_below_dentin));
  lines.push_back(c.least_to_pulp
                      ? fmt::format("  pulp      {:.2f} mm from the bur, at {:.2f} {:.2f} {:.2f}",
                                    *c.least_to_pulp, c.least_to_pulp_at.x(),
                                    c.least_to_pulp_at.y(), c.least_to_pulp_at.z())
                      : std::string("  pulp      the tooth has none"));
  if (c.least_to_other)
    lines.push_back(fmt::format("  others    {} {:.2f} mm from the bur, at {:.2f} {:.2f} {:.2f}",
                                body_at(whole, c.least_to_other_at), *c.least_to_other,
                                c.least_to_other_at.x(), c.least_to_other_at.y(),
                                c.least_to_other_at.z()));
  lines.push_back(
      c.shank_overlap > 0
          ? fmt::format("  reach     the shank runs into the tooth from {:.2f} s on", c.shank_time)
          : std::string("  reach     the shank stays clear"));
  return lines;
}

std::vector<std::string> path_warnings(const PathCheck& c, const LayeredTooth& whole) {
  std::vector<std::string> warnings;
  if (c.least_distance > 0)
    warnings.push_back(
        fmt::format("the path doesn't touch the tooth (nearest {:.2f} mm)", c.least_distance));
  else if (c.clearance_at_start <= 0)
    warnings.push_back("the path begins with the bur in the tooth");
  if (c.least_to_pulp && *c.least_to_pulp <= 0)
    warnings.push_back(
        fmt::format("the path opens the pulp at {:.2f} {:.2f} {:.2f} mm, by {:.2f} mm, at {:.2f} s",
                    c.least_to_pulp_at.x(), c.least_to_pulp_at.y(), c.least_to_pulp_at.z(),
                    -*c.least_to_pulp, c.least_to_pulp_time));
  else if (c.least_to_pulp && *c.least_to_pulp < kThinDentin)
    warnings.push_back(
        fmt::format("the path comes within {:.2f} mm of the pulp", *c.least_to_pulp));
  if (c.least_to_other && *c.least_to_other <= 0)
    warnings.push_back(fmt::format(
        "the path cuts {} at {:.2f} {:.2f} {:.2f} mm, by {:.2f} mm, at {:.2f} s",
        body_at(whole, c.least_to_other_at), c.least_to_other_at.x(), c.least_to_other_at.y(),
        c.least_to_other_at.z(), -*c.least_to_other, c.least_to_other_time));
  if (c.shank_overlap > 0)
    warnings.push_back(fmt::format(
        "the shank runs into the tooth ({:.2f} mm3, first at {:.2f} s): the bur is too short there",
        c.shank_overlap, c.shank_time));
  return warnings;
}

}  // namespace toothprep::app
