// toothprep import: a recording of another lab as a trajectory.
#include <fmt/format.h>

#include <iostream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "command.h"
#include "strictness.h"
#include "toothprep/build_info.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/hash.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/io/outputs.h"
#include "toothprep/tools/recordings/import_recording.h"
#include "toothprep/version.h"

namespace toothprep::app {
namespace {

using Json = nlohmann::ordered_json;

const std::map<std::string, double> kLengths = {
    {"mm", 1}, {"m", 1000}, {"um", 1e-3}, {"cm", 10}, {"in", 25.4}};
constexpr double kGramForce = 0.00980665;  // N
const std::map<std::string, double> kForces = {
    {"N", 1}, {"mN", 1e-3}, {"gf", kGramForce}, {"g", kGramForce}, {"kgf", 1000 * kGramForce}};
const std::map<std::string, double> kAngles = {{"deg", units::kPi / 180}, {"rad", 1}};
const std::map<std::string, QuaternionOrder> kQuaternions = {{"xyzw", QuaternionOrder::kXyzw},
                                                             {"wxyz", QuaternionOrder::kWxyz}};

struct Options {
  std::string input, output, columns, length_unit, force_unit, angle_unit, quaternion, euler,
      transform, tracked_to_bur, force_file, force_on = "bur", plot;
  std::optional<double> rate_hz, force_delay_ms;
  std::vector<double> tip_offset;
  double smooth_motion_ms = 0;
  bool in_world = false, despike = false, keep_held = false, force = false, json = false,
       strict = false;
};

template <class Value>
std::optional<Value> chosen(const std::map<std::string, Value>& choices, const std::string& name) {
  const auto found = choices.find(name);
  return found == choices.end() ? std::nullopt : std::optional(found->second);
}

ImportSettings settings_of(const Options& o) {
  ImportSettings s;
  s.columns = o.columns;
  s.mm_per_unit = chosen(kLengths, o.length_unit);
  s.newton_per_unit = chosen(kForces, o.force_unit);
  s.radian_per_unit = chosen(kAngles, o.angle_unit);
  s.quaternion = chosen(kQuaternions, o.quaternion).value_or(QuaternionOrder::kAsNamed);
  s.rate_hz = o.rate_hz;
  s.euler = o.euler;
  if (!o.transform.empty()) s.to_world = read_rigid_transform(o.transform);
  if (!o.tracked_to_bur.empty()) s.tracked_to_bur = read_rigid_transform(o.tracked_to_bur);
  if (!o.tip_offset.empty())  // of the tip from what was tracked, in its frame
    s.tracked_to_bur.position += Vec3(o.tip_offset[0], o.tip_offset[1], o.tip_offset[2]);
  s.in_world = o.in_world;
  s.force_file = o.force_file;
  s.force_on_tooth = o.force_on == "tooth";
  if (o.force_delay_ms) s.force_delay_s = *o.force_delay_ms * 1e-3;
  s.despike = o.despike;
  s.keep_held = o.keep_held;
  s.smooth_s = o.smooth_motion_ms * 1e-3;
  return s;
}

Json report_json(const Options& o, const ImportedRecording& r) {
  const ImportFigures& f = r.figures;
  const auto optional = [](const std::optional<double>& value) {
    return value ? Json(*value) : Json(nullptr);
  };
  Json j;
  j["schema"] = "toothprep-import";
  j["schema_version"] = 1;
  j["toothprep_version"] = kVersion;
  j["build"] = build_text();
  j["input"] = o.input;
  j["kind"] = r.kind;
  j["columns"] = Json::array();
  for (const ColumnUse& use : r.columns)
    j["columns"].push_back(
        {{"quantity", use.quantity}, {"column", use.column}, {"unit", use.unit}});
  j["rows"] = f.rows;
  j["samples"] = f.samples;
  j["duration_s"] = f.duration_s;
  j["rate_hz"] = f.rate_hz;
  j["gaps"] = f.gaps;
  j["largest_gap_s"] = f.largest_gap_s;
  j["missing_rows"] = f.missing;
  j["repeated_times"] = f.repeated_times;
  j["spikes"] = f.spikes;
  j["held_poses"] = f.held;
  j["position_step_mm"] = f.position_step_mm;
  j["path_mm"] = f.path_mm;
  j["median_speed_mm_s"] = f.median_speed_mm_s;
  j["largest_speed_mm_s"] = f.largest_speed_mm_s;
  j["bounds_mm"] = {{f.low[0], f.low[1], f.low[2]}, {f.high[0], f.high[1], f.high[2]}};
  j["largest_force_n"] = optional(f.largest_force_n);
  j["force_delay_s"] = optional(f.force_delay_s);
  j["force_delay_std_s"] = optional(f.force_delay_std_s);
  j["notes"] = r.notes;
  j["warnings"] = r.warnings;
  return j;
}

void say_summary(const Options& o, const ImportedRecording& r, const Common& common) {
  const ImportFigures& f = r.figures;
  say(common, fmt::format("{}: {}", o.input, r.kind));
  std::string columns;
  for (const ColumnUse& use : r.columns)
    columns += (columns.empty() ? "" : ", ") + use.quantity + " = '" + use.column + "'";
  if (!columns.empty()) say(common, "  columns   " + columns);
  for (const std::string& note : r.notes) say(common, "  note      " + note);
  say(common, fmt::format("  samples   {} in {:.3f} s, {:.4g} Hz, largest gap {:.4g} s", f.samples,
                          f.duration_s, f.rate_hz, f.largest_gap_s));
  say(common,
      fmt::format("  path      {:.1f} mm at {:.3g} mm/s (median while moving), at most {:.3g} mm/s",
                  f.path_mm, f.median_speed_mm_s, f.largest_speed_mm_s));
  say(common, fmt::format("  within    {:.2f} {:.2f} {:.2f} to {:.2f} {:.2f} {:.2f} mm", f.low[0],
                          f.low[1], f.low[2], f.high[0], f.high[1], f.high[2]));
  if (f.largest_force_n)
    say(common, fmt::format("  force     at most {:.3g} N", *f.largest_force_n));
}

void run(const Options& o, const Common& common) {
  Outputs outputs(o.force);
  outputs.reads({o.input, o.transform, o.tracked_to_bur, o.force_file});
  const std::string output = outputs.file(o.output, {".h5", ".hdf5"});
  const std::string plot = outputs.optional_file(o.plot, {".png", ".svg", ".pdf"});
  outputs.begin();
  const ImportedRecording recording = import_recording(o.input, settings_of(o));
  std::vector<std::string> warnings;
  for (const std::string& text : recording.warnings) warnings.push_back(o.input + ": " + text);
  warn_or_refuse(warnings, o.strict);
  write_imported(recording, {o.input, sha256_of_file(o.input), kVersion}, output);
  if (!plot.empty() && !run_script("plot-recording", {output, "-o", plot, "--force"}))
    throw Error(o.plot +
                ": the picture can't be drawn (python3-numpy, python3-h5py, python3-matplotlib)");
  outputs.publish();
  say_summary(o, recording, common);
  if (o.json) std::cout << json_text(report_json(o, recording));
}

// Why `order` is no order of three turns; empty if it is one.
std::string objection_to_order(const std::string& order) {
  const bool letters = order.size() == 3 && (order.find_first_not_of("xyz") == std::string::npos ||
                                             order.find_first_not_of("XYZ") == std::string::npos);
  if (letters && order[0] != order[1] && order[1] != order[2]) return {};
  return "'" + order + "' is not three of xyz (fixed axes) or XYZ (the body's own), e.g. ZYX";
}

template <class Value>
std::vector<std::string> names_of(const std::map<std::string, Value>& choices) {
  std::vector<std::string> names;
  names.reserve(choices.size());
  for (const auto& [name, value] : choices) names.push_back(name);
  return names;
}

void add_meaning(CLI::App& sub, Options& o) {
  sub.add_option(
      "--columns", o.columns,
      "Which column is what: time=NAME,x=NAME,... A NAME is the header's text or the\n"
      "column's number from 1. Keys: time, x, y, z, qx..qw, rx, ry, rz (angles about the\n"
      "axes), e1..e3 (in the order of --euler), r11..r33, axis_x.., angle, fx, fy, fz,\n"
      "buttons, rotation_rate, torque, stalled");
  sub.add_option("--length-unit", o.length_unit, "Of positions, whatever the names say")
      ->check(CLI::IsMember(names_of(kLengths)));
  sub.add_option("--force-unit", o.force_unit, "Of forces; g means gf")
      ->check(CLI::IsMember(names_of(kForces)));
  sub.add_option("--angle-unit", o.angle_unit, "Of angles")
      ->check(CLI::IsMember(names_of(kAngles)));
  sub.add_option("--rate-hz", o.rate_hz,
                 "Samples per second, where there is no time (or none to trust)")
      ->check(CLI::PositiveNumber);
  sub.add_option("--quaternion", o.quaternion,
                 "Order of the quaternion's columns, from left to right")
      ->check(CLI::IsMember(names_of(kQuaternions)));
  sub.add_option("--euler", o.euler,
                 "Order of the turns: zyx about fixed axes, ZYX about the body's own")
      ->check(CLI::Validator(objection_to_order, "ORDER"));
  sub.add_option("--transform", o.transform,
                 "Takes the recording's frame to the tooth's (.toml: translation_mm and\n"
                 "rotation_xyzw, or matrix)");
  sub.add_option(
      "--marker-to-bur", o.tracked_to_bur,
      "The bur (tip, +z to the shank) in the frame of what was tracked (.toml, the same)");
  sub.add_option("--tip-offset-mm", o.tip_offset,
                 "The tip from what was tracked, in its frame: X,Y,Z")
      ->delimiter(',')
      ->expected(3);
  sub.add_flag("--in-world", o.in_world, "Of a simulator's file: not relative to the anatomy");
}

}  // namespace

void add_import(CLI::App& app, const Common& common) {
  auto* sub = app.add_subcommand("import", "A recording of another lab as a trajectory");
  const auto o = std::make_shared<Options>();
  sub->add_option(
         "recording", o->input,
         "Table (.csv, .tsv, .txt, .log), or HDF5 of FIVRS or with /time and /handle/position")
      ->required();
  sub->add_option("-o,--output", o->output, "Recording to write (.h5)")->required();
  add_meaning(*sub, *o);
  sub->add_option("--force-file", o->force_file,
                  "Forces from a second table, with a clock of its own");
  sub->add_option("--force-delay-ms", o->force_delay_ms,
                  "Of the force file's clock behind the motion's (default: by cross-correlation)");
  sub->add_option("--force-on", o->force_on, "Whose force was measured: on the bur or on the tooth")
      ->check(CLI::IsMember({"bur", "tooth"}))
      ->capture_default_str();
  sub->add_flag("--despike", o->despike, "Interpolate positions that jump away and back");
  sub->add_flag("--keep-held", o->keep_held, "Leave repeated poses of a slow tracker as they are");
  sub->add_option("--smooth-motion-ms", o->smooth_motion_ms,
                  "Window of a local quadratic through the motion; 0: none")
      ->check(CLI::Range(0.0, 1000.0))
      ->capture_default_str();
  sub->add_option("--plot", o->plot, "Picture of path, speed, gaps and forces (.png, .svg, .pdf)");
  sub->add_flag("--json", o->json, "What was read and assumed, as JSON on stdout");
  add_strict(*sub, o->strict, "anything assumed or odd");
  sub->add_flag("--force", o->force, "Replace an existing output");
  sub->footer(
      "Recognised by themselves: separators, decimal commas, headers with units, further columns,\n"
      "logs of H3D/HAPI, ROS tables, FIVRS. What is assumed is a warning; what can't be known is\n"
      "asked for. data/recordings/import.md has examples for each kind.\n"
      "Example: toothprep import tracker.csv --columns time=Time,x=PosX,y=PosY,z=PosZ -o path.h5");
  sub->callback([o, &common] { run(*o, common); });
}

}  // namespace toothprep::app
