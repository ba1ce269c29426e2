// toothprep info: what a tooth, trace, trajectory, scan or mesh holds.
#include <fmt/format.h>
#include <tbb/parallel_invoke.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>

#include "command.h"
#include "frame_json.h"
#include "strictness.h"
#include "toothprep/build_info.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/hash.h"
#include "toothprep/step/core/regular_file.h"
#include "toothprep/tools/files/tooth_file.h"
#include "toothprep/tools/files/trace.h"
#include "toothprep/tools/io/file_extension.h"
#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/io/plain_text.h"
#include "toothprep/tools/mesh_files/mesh_file.h"
#include "toothprep/tools/scan_files/image_file.h"
#include "toothprep/tools/shells/closing.h"
#include "toothprep/version.h"

namespace toothprep::app {
namespace {

using Json = nlohmann::ordered_json;

struct Options {
  std::string file;
  bool json = false, strict = false;
};

Json list(const Vec3& v) { return {v.x(), v.y(), v.z()}; }
Json bounds(const Vec3& min, const Vec3& max) { return {list(min), list(max)}; }
Json by_tissue(const PerTissue<double>& values) {
  Json result;
  for (int k = 0; k < kTissueCount; ++k) result[std::string(kTissueNames[k])] = values[k];
  return result;
}

// What is odd about the file, for --strict and under the key `warnings`.
using Warnings = std::vector<std::string>;

void add(Warnings& warnings, const std::string& path, const std::vector<Finding>& findings) {
  for (const Finding& f : findings) warnings.push_back(path + ": " + message_of(f));
}

void describe_tooth(const std::string& path, Json& info, Warnings& warnings) {
  const ToothReading reading = read_tooth_with_warnings(path);
  const LayeredTooth& tooth = reading.tooth;
  warnings = reading.warnings;
  PerTissue<double> volume{};
  std::string tooth_hash, file_hash;
  tbb::parallel_invoke([&] { tooth_hash = tooth_sha256(tooth); },
                       [&] { file_hash = sha256_of_file(path); },
                       [&] { volume = remaining_volumes_mm3(tooth); });
  info["file_sha256"] = file_hash;
  double solid = 0;
  for (const double v : volume) solid += v;
  const Box box = bounds_of_solid(tooth);
  info["kind"] = "tooth";
  info["file_schema"] = "toothprep-tooth";
  info["voxel_mm"] = tooth.lattice.voxel;
  info["volume_mm3"] = by_tissue(volume);
  info["solid_volume_mm3"] = solid;
  info["bounds_mm"] = bounds(box.min, box.max);
  info["memory_bytes"] = memory_bytes(tooth);
  if (tooth.bodies) {
    const std::vector<double> volumes = body_volumes_mm3(tooth);
    for (std::size_t b = 0; b < volumes.size(); ++b) {
      const Body& body = tooth.bodies->list[b];
      info["bodies"][body.name] = {{"kind", kBodyKindNames[static_cast<std::size_t>(body.kind)]},
                                   {"volume_mm3", volumes[b]}};
    }
  }
  info["tooth_sha256"] = tooth_hash;
  if (tooth.parts)
    info["cut"] = {{"intact_tissues", tooth.parts->tissues.has_value()},
                   {"bur_way_parts", tooth.parts->way ? tooth.parts->way->parts.size() : 0}};
  const ToothFrame frame = recorded_frame(tooth.provenance);
  info["frame"] = frame_text(frame);
  put_frame(info, "frame_", frame);
  info["provenance"] = Json::object();
  for (const auto& [key, value] : tooth.provenance) info["provenance"][key] = value;
}

// Extent in time and space of a motion.
void describe_motion(const std::vector<HandleSample>& samples, Json& info) {
  Vec3 min = samples.front().pose.position, max = min;
  double length = 0;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    min = min.cwiseMin(samples[i].pose.position);
    max = max.cwiseMax(samples[i].pose.position);
    if (i > 0) length += (samples[i].pose.position - samples[i - 1].pose.position).norm();
  }
  const double duration = samples.back().time - samples.front().time;
  info["rows"] = samples.size();
  info["start_s"] = samples.front().time;
  info["duration_s"] = duration;
  info["mean_rate_hz"] = duration > 0 ? static_cast<double>(samples.size() - 1) / duration : 0.0;
  info["handle_path_mm"] = length;
  info["bounds_mm"] = bounds(min, max);
}

void describe_trajectory(const std::string& path, const Trajectory& trajectory, Json& info,
                         Warnings& warnings) {
  info["kind"] = "trajectory";
  add(warnings, path,
      judge_motion(trajectory.samples, trajectory.loaded ? Drive::kLoad : Drive::kCoupled));
  describe_motion(trajectory.samples, info);
  info["has_measured_force"] = !trajectory.measured_force.empty();
  if (trajectory.loaded) info["has_load"] = true;
}

// Not of a recording that was cut off, which has no audit, nor of another version's trace with
// parameters that this one doesn't know.
void judge_trace(const std::string& path, const Trace& trace, double peak_force, double lag,
                 Json& info, Warnings& warnings) {
  if (std::isnan(trace.audit.torque_work_mj)) return;
  Parameters parameters;
  try {
    parameters = parse_parameters(trace.parameters_toml, path + ": parameters");
  } catch (const Error&) {
    return;
  }
  const Audit audit = judge_audit(trace.audit.torque_work_mj, trace.audit.removed_energy_mj,
                                  trace.rows.back().removed_volume, parameters);
  const auto findings = judge_run(judge_parameters(parameters), audit, peak_force, lag,
                                  drive_named(trace.drive).value_or(Drive::kCoupled));
  put_judgement(info, audit, findings);
  add(warnings, path, findings);
}

// What was done to a live session.
Json events_json(const SessionEvents& all) {
  Json list = Json::array();
  for (const SessionEvent& event : all.events) {
    Json& one = list.emplace_back(Json{{"time_s", event.time}, {"kind", name_of(event.kind)}});
    const auto bur = static_cast<std::size_t>(event.arguments[0]);
    if (event.kind == EventKind::kBur && bur < all.burs.size()) one["bur"] = all.burs[bur];
  }
  return list;
}

void describe_trace(const std::string& path, Json& info, Warnings& warnings) {
  const Trace trace = read_trace(path);
  if (trace.unfinished) warnings.push_back(unfinished_text(path));
  if (trace.rows_every > 1) warnings.push_back(sparse_text(path, trace.rows_every));
  info["kind"] = "trace";
  info["file_schema"] = "toothprep-trace";
  std::vector<HandleSample> handle;
  handle.reserve(trace.rows.size());
  double grinding = 0, device = 0, torque = 0, lag = 0;
  std::size_t stalled = 0;
  PerTissue<double> contact{};
  for (const StepRecord& row : trace.rows) {
    handle.push_back(row.handle);
    grinding = std::max(grinding, row.grinding_force.norm());
    device = std::max(device, row.device_force.norm());
    torque = std::max(torque, row.torque);
    lag = std::max(lag, (row.bur.position - row.handle.pose.position).norm());
    stalled += row.stalled;
    for (int k = 0; k < kTissueCount; ++k) contact[k] = std::max(contact[k], row.contact_area[k]);
  }
  describe_motion(handle, info);
  const PerTissue<double>& removed = trace.rows.back().removed_volume;
  info["peak_force_n"] = grinding;
  info["peak_device_force_n"] = device;
  info["peak_torque_mnm"] = torque;
  info["stalled_steps"] = stalled;
  if (trace.rows_every > 1) info["rows_every"] = trace.rows_every;
  info["largest_lag_mm"] = lag;
  info["tissues"] = Json::array();  // that were touched or removed
  for (int k = 0; k < kTissueCount; ++k)
    if (contact[k] > 0 || removed[k] > 0) info["tissues"].push_back(std::string(kTissueNames[k]));
  info["removed_mm3"] = by_tissue(removed);
  info["initial_overlap_mm3"] = trace.initial_overlap_mm3;
  info["torque_work_mj"] = trace.audit.torque_work_mj;
  info["removed_energy_mj"] = trace.audit.removed_energy_mj;
  info["energy_ratio"] = trace.audit.energy_ratio;
  if (!trace.tooth_sha256.empty())  // else an active check of a device, where the hand may rest
    add(warnings, path, judge_motion(handle, drive_named(trace.drive).value_or(Drive::kCoupled)));
  judge_trace(path, trace, device, lag, info, warnings);
  info["has_measured_force"] = !trace.measured_force.empty();
  if (!trace.events.events.empty()) info["events"] = events_json(trace.events);
  info["bur"] = trace.bur;
  info["drive"] = trace.drive;
  info["engine"] = trace.engine;
  info["tooth_sha256"] = trace.tooth_sha256;
  info["toothprep_version"] = trace.toothprep_version;
  info["parameters"] = trace.parameters_toml;
}

// A folder of several DICOM series: one of them is a scan, together they are a list.
void describe_series(const std::vector<SeriesInfo>& series, Json& info) {
  info["kind"] = "dicom-series";
  info["series"] = Json::array();
  for (const SeriesInfo& s : series)
    info["series"].push_back({{"place", s.place},
                              {"number", s.number ? Json(*s.number) : Json(nullptr)},
                              {"uid", s.uid},
                              {"description", s.description},
                              {"modality", s.modality},
                              {"slices", s.slices},
                              {"columns", s.columns},
                              {"rows", s.rows}});
}

void describe_scan(const std::string& path, Json& info) {
  info["file_sha256"] = sha256_of_scan(path);
  const auto scan = open_scan(path);
  const ImageFrame& frame = scan->frame();
  const std::size_t area = static_cast<std::size_t>(frame.size.x()) * frame.size.y();
  float least = std::numeric_limits<float>::infinity(), most = -least;
  double sum = 0;
  for_each_slab(*scan, [&](int, int count, const float* values) {
    for (std::size_t v = 0; v < area * static_cast<std::size_t>(count); ++v) {
      least = std::min(least, values[v]);
      most = std::max(most, values[v]);
      sum += values[v];
    }
  });
  info["kind"] = "scan";
  info["size"] = {frame.size.x(), frame.size.y(), frame.size.z()};
  info["spacing_mm"] = list(frame.spacing);
  info["origin_mm"] = list(frame.origin);
  info["direction"] = Json::array();  // row by row
  for (int r = 0; r < 3; ++r) info["direction"].push_back(list(frame.direction.row(r)));
  info["min"] = least;
  info["max"] = most;
  info["mean"] = sum / static_cast<double>(frame.voxels());
  if (!scan->notes().empty()) info["notes"] = scan->notes();
}

// Whether it bounds something, its parts and openings, and what unit its size speaks of.
void describe_shells(const std::string& path, double longest, Json& info, Warnings& warnings) {
  constexpr std::size_t kMost = 40;  // parts and openings that are listed
  const ShellSurvey survey = survey_shell(read_shell(path, {}, true));
  info["closed"] = survey.openings.empty();
  info["parts_count"] = survey.parts.size();
  info["parts"] = Json::array();
  for (std::size_t p = 0; p < std::min(kMost, survey.parts.size()); ++p) {
    const ShellPart& part = survey.parts[p];
    info["parts"].push_back({{"center_mm", list(0.5 * (part.bounds.min + part.bounds.max))},
                             {"bounds_mm", bounds(part.bounds.min, part.bounds.max)},
                             {"triangles", part.triangles},
                             {"area_mm2", part.area_mm2},
                             {"closed", part.closed},
                             {"volume_mm3", part.closed ? Json(part.volume_mm3) : Json(nullptr)}});
  }
  info["openings_count"] = survey.openings.size();
  info["openings"] = Json::array();
  for (std::size_t o = 0; o < std::min(kMost, survey.openings.size()); ++o) {
    const ShellOpening& opening = survey.openings[o];
    info["openings"].push_back({{"center_mm", list(opening.centre)},
                                {"width_mm", opening.width},
                                {"rim_mm", opening.length},
                                {"edges", opening.edges}});
  }
  const MeshUnit* unit = likely_mesh_unit(longest);
  info["likely_length_unit"] = unit ? unit->name : "mm";
  if (unit)
    warnings.push_back(
        fmt::format("{}: its longest side is {:.3g} mm, or {:.3g} mm if the file is in {}: "
                    "--length-unit {} of voxelize and score says so",
                    path, longest, longest * unit->mm, unit->word, unit->name));
}

void describe_mesh(const std::string& path, Json& info, Warnings& warnings) {
  const MeshFile mesh = read_mesh_file(path);
  const auto refuse = [&](const std::string& condition) {
    throw InputError(path, "", condition, "is the mesh complete?");
  };
  if (mesh.points.empty()) refuse("holds no vertices");
  Vec3 low = mesh.points[0], high = low;
  for (const Vec3& x : mesh.points) {
    if (!x.allFinite()) refuse("holds a vertex that is not finite");
    low = low.cwiseMin(x);
    high = high.cwiseMax(x);
  }
  std::uint64_t triangles = 0;
  for (std::size_t face = 0, begin = 0; face < mesh.ends.size(); begin = mesh.ends[face++]) {
    if (mesh.ends[face] < begin + 3) refuse("holds a face of fewer than three corners");
    triangles += mesh.ends[face] - begin - 2;
  }
  info["kind"] = "mesh";
  info["format"] = mesh.format;
  info["vertices"] = mesh.points.size();
  info["triangles"] = triangles;
  info["bounds_mm"] = bounds(low, high);
  describe_shells(path, (high - low).maxCoeff(), info, warnings);
}

std::string scalar(const Json& value) {
  if (!value.is_number_float())
    return value.is_string() ? terminal_text(value.get<std::string>()) : value.dump();
  return fmt::format("{:.6g}", value.get<double>());
}

// The same keys as the JSON, a line each; a text of several lines below its key.
void print(const Json& info) {
  std::size_t width = 0;
  for (const auto& [key, value] : info.items()) width = std::max(width, key.size());
  for (const auto& [key, value] : info.items()) {
    std::string line = key + std::string(width + 2 - key.size(), ' ');
    if (value.is_object()) {
      for (const auto& [name, part] : value.items())
        line +=
            (name == value.begin().key() ? "" : ", ") + terminal_text(name) + " " + scalar(part);
    } else if (value.is_array()) {
      for (const Json& part : value)
        if (part.is_array())
          for (const Json& number : part)
            line += (&number == &part.front() ? (&part == &value.front() ? "" : "  |  ") : " ") +
                    scalar(number);
        else if (part.is_object()) {
          line += "\n ";
          for (const auto& [name, field] : part.items()) line += " " + name + " " + scalar(field);
        } else {
          line += (&part == &value.front() ? "" : " ") + scalar(part);
        }
    } else {
      const std::string text = scalar(value);
      if (text.find('\n') != std::string::npos) line += '\n';
      line += text;
    }
    while (!line.empty() && (line.back() == '\n' || line.back() == ' ')) line.pop_back();
    std::cout << line << '\n';
  }
}

void run(const Options& o) {
  namespace fs = std::filesystem;
  std::error_code error;
  if (!fs::exists(o.file, error))
    throw InputError(o.file, "", "does not exist", "check the file's name");
  const bool folder = fs::is_directory(o.file, error);
  const std::string extension = file_extension(o.file);
  Json info;
  Warnings warnings;
  info["schema"] = "toothprep-info";
  info["schema_version"] = 1;
  info["toothprep_version"] = kVersion;  // of a trace: its own, below
  info["build"] = build_text();
  info["file"] = o.file;
  if (!folder) {
    regular_file_size(o.file);
    info["file_sha256"] = nullptr;  // stands here, but is taken of what could be read only
  }
  if (folder) {
    const std::vector<SeriesInfo> series = list_series(o.file);
    series.size() > 1 ? describe_series(series, info) : describe_scan(o.file, info);
  } else if (extension == ".vdb")
    describe_tooth(o.file, info, warnings);
  else if (extension == ".h5" || extension == ".hdf5")
    is_trace_file(o.file) ? describe_trace(o.file, info, warnings)
                          : describe_trajectory(o.file, read_h5_trajectory(o.file), info, warnings);
  else if (extension == ".csv")
    describe_trajectory(o.file, read_csv_trajectory(o.file), info, warnings);
  else if (extension == ".toml")
    describe_trajectory(o.file, read_script(o.file), info, warnings);
  else if (is_mesh_file(o.file))
    describe_mesh(o.file, info, warnings);
  else
    describe_scan(o.file, info);
  if (!folder && info["file_sha256"].is_null()) info["file_sha256"] = sha256_of_file(o.file);
  if (!warnings.empty()) info["warnings"] = warnings;
  warn_or_refuse(warnings, o.strict);
  if (o.json)
    std::cout << json_text(info);
  else
    print(info);
  if (!std::cout.flush()) throw Error("stdout cannot be written");
}

}  // namespace

void add_info(CLI::App& app, const Common&) {
  auto* sub = app.add_subcommand("info", "What a tooth, trace, trajectory, scan or mesh holds");
  const auto o = std::make_shared<Options>();
  sub->add_option("file", o->file,
                  "Tooth (.vdb), trace or trajectory (.h5, .csv, .toml), mesh (.ply, .stl, .obj, "
                  ".off, .gz of these), or a "
                  "scan (.nrrd, .nii, .mha, ..., or a folder of DICOM)")
      ->required();
  add_strict(*sub, o->strict,
             "a tooth that another program changed, an implausible motion, trace or size");
  sub->add_flag("--json", o->json, "As one JSON object on stdout");
  sub->footer(
      "Keys carry their unit. Always: schema, schema_version, file, file_sha256, kind. Besides:\n"
      "  tooth       voxel_mm, volume_mm3 (what remains, by tissue), solid_volume_mm3, bounds_mm\n"
      "              ([min, max]), memory_bytes, tooth_sha256, cut (of a tooth that was cut here: "
      "what\n"
      "              the next session finds), frame (a sentence) and frame_* (as `orient --json` "
      "has\n"
      "              it), provenance\n"
      "  trajectory  rows, start_s, duration_s, mean_rate_hz, handle_path_mm, bounds_mm,\n"
      "              has_measured_force\n"
      "  trace       as a trajectory, and peak_force_n (grinding), peak_device_force_n,\n"
      "              peak_torque_mnm, stalled_steps, largest_lag_mm, tissues (touched), "
      "removed_mm3 (by\n"
      "              tissue), initial_overlap_mm3, torque_work_mj, removed_energy_mj, energy_ratio "
      "(null\n"
      "              if nothing was removed), bur, drive, engine, tooth_sha256, parameters (TOML)\n"
      "  scan        size (voxels), spacing_mm, origin_mm, direction (rows; LPS), min, max, mean\n"
      "  mesh        format, vertices, triangles, bounds_mm, closed, parts (what hangs together, "
      "the\n"
      "              largest first: center_mm, bounds_mm, triangles, area_mm2, closed, "
      "volume_mm3),\n"
      "              openings (center_mm, width_mm, rim_mm, edges), likely_length_unit\n"
      "Example: toothprep info molar.vdb --json");
  sub->callback([o] { run(*o); });
}

}  // namespace toothprep::app
