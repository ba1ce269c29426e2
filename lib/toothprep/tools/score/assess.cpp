#include "toothprep/tools/score/assess.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/hash.h"
#include "toothprep/step/core/regular_file.h"
#include "toothprep/step/session/plausibility.h"
#include "toothprep/tools/compare/cut_surface.h"
#include "toothprep/tools/io/label_source.h"
#include "toothprep/tools/io/scan_uncertainty.h"
#include "toothprep/tools/orientation/estimate_frame.h"
#include "toothprep/tools/score/body_damage.h"

namespace toothprep {
namespace {

// A surface that was resampled or laid on another one is noisy; what lies within the tolerance
// doesn't count as cut.
constexpr double kResampledVoxels = 0.3;  // voxels
constexpr double kResiduals = 3;          // registration residuals (RMS)

PreparationType type_named(const std::string& name) {
  return static_cast<PreparationType>(
      std::find(kPreparationTypes.begin(), kPreparationTypes.end(), name) -
      kPreparationTypes.begin());
}

// `shift`: of a volume's whole surface, mm, half width of the 95 % interval.
void add_volumes(Quantities& quantities, const VolumeComparison& volumes, double voxel,
                 double shift) {
  const auto add = [&](const std::string& key, double value) {
    const double edge = std::cbrt(std::max(0.0, value)), area = 6 * edge * edge;
    quantities.push_back({key, value, volume_uncertainty_mm3(value, voxel) + shift * area, "mm^3"});
  };
  for (int k = 0; k < kTissueCount; ++k)
    if (volumes.original.tissue[k] > 0)
      add("removed_mm3." + std::string(kTissueNames[k]), volumes.removed.tissue[k]);
  add("removed_mm3.total", volumes.removed.total);
  const auto other = static_cast<std::size_t>(tissue_index(Tissue::kOther));
  const bool layered = volumes.original.tissue[0] > 0 || volumes.original.tissue[1] > 0;
  if (layered && volumes.original.tissue[other] > 0)
    add("neighbour_damage_mm3", volumes.removed.tissue[other]);
  if (!volumes.has_target) return;
  add("required_mm3", volumes.required.total);
  add("removed_inside_mm3", volumes.inside.total);
  add("over_prepared_mm3", volumes.over.total);
  add("under_prepared_mm3", volumes.under.total);
  for (int k = 0; k < kTissueCount; ++k)
    if (volumes.original.tissue[k] > 0)
      add("over_prepared_by_tissue_mm3." + std::string(kTissueNames[k]), volumes.over.tissue[k]);
  if (std::isfinite(volumes.dice)) quantities.push_back({"dice", volumes.dice, NAN, "1"});
}

void add_deviation(Quantities& quantities, const Deviation& deviation, double voxel) {
  const auto add = [&](const std::string& key, double value, double uncertainty, const char* unit) {
    quantities.push_back({key, value, uncertainty, unit});
  };
  add("deviation_mean_mm", deviation.mean_mm, voxel / 10, "mm");
  add("deviation_rms_mm", deviation.rms_mm, voxel / 5, "mm");
  add("deviation_p95_mm", deviation.p95_mm, voxel / 2, "mm");
  add("hausdorff_mm", deviation.hausdorff_mm, voxel, "mm");
  add("deviation_within_0_1mm", deviation.share_within_0_1, NAN, "1");
  add("deviation_within_0_2mm", deviation.share_within_0_2, NAN, "1");
}

bool is_of_scan(const Solid& solid) {
  return solid.layered && !solid.tooth.parts && solid.tooth.provenance.contains("threshold_dentin");
}

// Two scans of a tooth have each their own noise, also where nothing was cut.
bool are_of_different_scans(const Solid& a, const Solid& b) {
  const auto source = [](const Solid& solid) {
    const auto found = solid.tooth.provenance.find("source_sha256");
    return found == solid.tooth.provenance.end() ? std::string() : found->second;
  };
  return is_of_scan(a) && is_of_scan(b) && source(a) != source(b);
}

// `solid` in the original's frame and lattice. Raises `surface_tolerance_mm` to the noise of the
// way.
Solid placed(const Solid& solid, const Solid& original, const AssessmentOptions& options,
             const char* role, Quantities& quantities, std::vector<std::string>& notes,
             double& surface_tolerance_mm) {
  Pose motion;
  if (options.register_teeth) {
    const SurfaceRegistration registration = register_surfaces(solid, original);
    motion = registration.motion;
    for (const std::string& note : registration.notes) notes.push_back(solid.file + ": " + note);
    notes.push_back(std::string("the ") + role +
                    fmt::format(" tooth was laid on the original: turned by {:.3g} degrees, moved "
                                "by {:.3g} mm, residual {:.3g} mm (RMS)",
                                registration.angle_deg, registration.shift_mm,
                                registration.residual_rms_mm));
    quantities.push_back({"registration_rms_mm", registration.residual_rms_mm, NAN, "mm"});
    surface_tolerance_mm =
        std::max(surface_tolerance_mm, kResiduals * registration.residual_rms_mm);
  }
  if (!is_identity(motion) || !solid.layered || !original.layered ||
      are_of_different_scans(solid, original) ||
      !same_lattice(solid.tooth.lattice, original.tooth.lattice))
    surface_tolerance_mm =
        std::max(surface_tolerance_mm, kResampledVoxels * original.tooth.lattice.voxel);
  return on_lattice(solid, original, motion);
}

// What the recording of the work says against itself. Nothing of one that was cut off, or whose
// parameters are of another version.
std::vector<std::string> judge_trace(const std::string& file, const Trace& trace) {
  if (trace.rows.empty() || std::isnan(trace.audit.torque_work_mj)) return {};
  Parameters parameters;
  try {
    parameters = parse_parameters(trace.parameters_toml, file + ": parameters");
  } catch (const Error&) {
    return {};
  }
  double force = 0, lag = 0;
  for (const StepRecord& row : trace.rows) {
    force = std::max({force, row.device_force.norm(), row.grinding_force.norm()});
    lag = std::max(lag, (row.bur.position - row.handle.pose.position).norm());
  }
  const Audit audit = judge_audit(trace.audit.torque_work_mj, trace.audit.removed_energy_mj,
                                  trace.rows.back().removed_volume, parameters);
  std::vector<std::string> warnings;
  for (const Finding& f : judge_run(judge_parameters(parameters), audit, force, lag,
                                    drive_named(trace.drive).value_or(Drive::kCoupled)))
    warnings.push_back(file + ": " + message_of(f));
  return warnings;
}

// The type that is given, or the rubric's, or found by the shape; the sheet says which.
PreparationType choose_type(const AssessmentOptions& options, const Assessment& result,
                            const PreparationOptions& preparation, ScoreSheet& sheet) {
  if (options.type) {
    sheet.type_from = "given";
    return *options.type;
  }
  if (options.rubric) {
    sheet.type_from = "the rubric";
    return type_named(options.rubric->type);
  }
  const PreparationType type = guess_type(result.original.tooth, result.prepared.tooth,
                                          result.preparation_surface, preparation);
  sheet.type_from = "found";
  sheet.notes.push_back("taken as a preparation of type " +
                        std::string(kPreparationTypes[static_cast<std::size_t>(type)]) +
                        " by its shape; give --type if it is another");
  return type;
}

// The recordings and their figures; returns what is implausible in them.
std::vector<std::string> add_process(const AssessmentOptions& options, Assessment& result,
                                     Quantities& quantities) {
  std::vector<std::size_t> starts;
  std::vector<std::string> warnings;
  for (const std::string& file : options.traces) {
    Trace trace = read_trace(file);
    if (trace.unfinished) warnings.push_back(unfinished_text(file));
    if (trace.rows_every > 1) warnings.push_back(sparse_text(file, trace.rows_every));
    for (const std::string& warning : judge_trace(file, trace)) warnings.push_back(warning);
    if (result.trace) {  // made on what the one before left
      starts.push_back(append_recording(result.trace->rows, trace.rows));
      continue;
    }
    const std::string original =
        result.original.bodies ? result.original.sha256 : tooth_sha256(result.original.tooth);
    if (!trace.tooth_sha256.empty() && trace.tooth_sha256 != original)
      result.sheet.notes.push_back(file +
                                   ": was recorded on another tooth than the original given here");
    result.trace = std::move(trace);
  }
  result.process =
      process_figures(result.trace->rows, options.process, starts, result.trace->bodies);
  quantities.insert(quantities.end(), result.process->quantities.begin(),
                    result.process->quantities.end());
  return warnings;
}

// The tooth's own frame, where its file has none.
void find_tooth_frame(LayeredTooth& tooth) {
  const ToothFrame recorded = recorded_frame(tooth.provenance);
  if (recorded.occlusal.known() || tooth.provenance.contains("frame_confidence")) return;
  record_frame(estimate_frame(tooth, known_axes(recorded)), tooth.provenance);
}

// Of the labels that a tooth's surfaces come from, mm; 0 if from none. Says so in the notes.
double noted_label_spacing(const Solid& solid, const std::string& file,
                           std::vector<std::string>& notes) {
  const std::optional<LabelSource> labels = recorded_labels(solid.tooth.provenance);
  if (!labels) return 0;
  notes.push_back(file + fmt::format(": {} from labels of {:.4g} mm ({}); the uncertainties "
                                     "include that",
                                     solid.tooth.parts ? "was cut here, its other surfaces come"
                                                       : "its surfaces come",
                                     labels->spacing_mm,
                                     labels->smooth ? "smoothed" : "with their steps"));
  return labels->spacing_mm;
}

// Neighbours and pulp that the original doesn't have can't be hurt: that earns no points. What a
// recording says to have touched is judged nevertheless, unless the original has no tissues, where
// it is the tooth itself.
void add_what_is_not_there(const Assessment& result, ScoreSheet& sheet) {
  const Quantities& quantities = sheet.quantities;
  const bool has_tissues = find_quantity(quantities, "removed_mm3.enamel") ||
                           find_quantity(quantities, "removed_mm3.dentin");
  const auto add = [&](const char* key, const char* reason) {
    const Quantity* figure = find_quantity(quantities, key);
    if (!figure || figure->value == 0 || !has_tissues) sheet.absent.push_back({key, reason});
  };
  if (!find_quantity(quantities, "removed_mm3.pulp"))
    add("process.pulp_contact_s", "the original has no pulp");
  const std::vector<Body> none;
  const std::vector<Body>& recorded = result.trace ? result.trace->bodies : none;
  if (find_quantity(quantities, "neighbour_damage_mm3") ||
      std::any_of(recorded.begin(), recorded.end(),
                  [](const Body& b) { return b.kind == BodyKind::kNeighbour; }))
    return;
  for (const char* key : {"neighbour_damage_mm3", "neighbour_depth_mm", "box_clearance_mm",
                          "process.neighbour_contact_s"})
    add(key, "the original has no neighbouring tooth");
}

// What was measured against an axis that isn't the tooth's can't be certain.
void judge_sheet(const Rubric& rubric, ScoreSheet& sheet) {
  Quantities judged = sheet.quantities;  // of what isn't there, no contact is no merit
  std::erase_if(judged, [&](const Quantity& q) {
    return std::any_of(sheet.absent.begin(), sheet.absent.end(),
                       [&](const AbsentQuantity& a) { return a.key == q.key; });
  });
  sheet.result = judge(rubric, judged, sheet.absent);
  if (sheet.axis_known || !sheet.result->certain) return;
  sheet.result->certain = false;
  sheet.result->notes.push_back(
      "the verdict is not certain: the tooth's occlusal axis is not known, only guessed from the "
      "cut; give --axis, or a tooth with its frame (`toothprep orient`)");
}

void add_input(ScoreSheet& sheet, const std::string& role, const std::string& file) {
  sheet.inputs.push_back({role, file, sha256_of_file(file)});
}

void keep_warnings(ScoreSheet& sheet, const std::vector<std::string>& warnings) {
  sheet.warnings.insert(sheet.warnings.end(), warnings.begin(), warnings.end());
}

void report_progress(const AssessmentOptions& options, const char* stage, double done) {
  if (options.progress) options.progress(stage, done);
}

// 95 % half width of where a scan shows the outer surface, mm; 0 of a tooth that is from none, was cut
// here, or whose file doesn't say. Says so in the notes.
double noted_scan_half_width(const Solid& solid, const std::string& file,
                             std::vector<std::string>& notes) {
  const auto widths = recorded_scan_half_widths(solid.tooth.provenance);
  if (!widths || !is_of_scan(solid)) return 0;
  const double width = std::max((*widths)[static_cast<int>(ScanSurface::kEnamelOutside)],
                                (*widths)[static_cast<int>(ScanSurface::kDentinOutside)]);
  if (width > 0)
    notes.push_back(file + fmt::format(": the scan shows its surface to +-{:.2g} mm (95 %); the "
                                       "uncertainties include that",
                                       width));
  return width;
}

struct Compared {
  Assessment assessment;  // without the preparation
  double surface_tolerance_mm = 0, coarser_voxel_mm = 0;
  double original_label_spacing = 0, cut_label_spacing = 0;  // mm; 0: from no labels
  double scan_half_width = 0;                                // mm, of what was cut; 0: from no scan
  bool pulp_exposed = false;
};

// Half width of the 95 % interval of a shift, mm, of the whole boundary of what was removed. In
// labels each face of a cavity is uncertain by half a voxel either way, evenly: 2 x 0.29/sqrt(6)
// voxels for the sum of six. Noise of 3 % in a scan shifts whole faces by less than a fiftieth of one;
// what its file says of single places (half width h) could be the same all over a face: h/sqrt(6).
double surface_shift_mm(const Compared& c, const Solid& prepared) {
  constexpr double kOfLabels = 0.24, kOfScans = 0.02;
  const bool of_scans = are_of_different_scans(prepared, c.assessment.original);
  const double scans = std::max(kOfScans * c.coarser_voxel_mm, c.scan_half_width / std::sqrt(6.0));
  return std::max(kOfLabels * c.cut_label_spacing, of_scans ? scans : 0.0);
}

Compared compared(const AssessmentOptions& options) {
  for (const std::string* file : {&options.original, &options.prepared, &options.target})
    if (!file->empty()) regular_file_size(*file);  // before any work

  Compared c;
  Assessment& result = c.assessment;
  ScoreSheet& sheet = result.sheet;
  report_progress(options, "reading the teeth", 0.0);
  result.original = read_solid(options.original, options.voxel, options.mm_per_unit);
  keep_warnings(sheet, result.original.warnings);
  find_tooth_frame(result.original.tooth);
  const double voxel = result.original.tooth.lattice.voxel;
  sheet.registered = options.register_teeth;
  sheet.mm_per_unit = options.mm_per_unit;
  add_input(sheet, "original", options.original);
  add_input(sheet, "prepared", options.prepared);
  const Solid prepared = read_solid(options.prepared, voxel, options.mm_per_unit);
  keep_warnings(sheet, prepared.warnings);
  c.original_label_spacing = noted_label_spacing(result.original, options.original, sheet.notes);
  const double of_prepared = noted_label_spacing(prepared, options.prepared, sheet.notes);
  c.cut_label_spacing = prepared.tooth.parts ? 0 : of_prepared;
  c.scan_half_width = noted_scan_half_width(prepared, options.prepared, sheet.notes);
  c.coarser_voxel_mm = std::max(voxel, prepared.tooth.lattice.voxel);
  sheet.voxel_mm = c.coarser_voxel_mm;
  report_progress(options, "laying them on each other", 0.2);
  result.prepared = placed(prepared, result.original, options, "prepared", sheet.quantities,
                           sheet.notes, c.surface_tolerance_mm);
  if (!options.target.empty()) {
    add_input(sheet, "target", options.target);
    Quantities unused;  // the score's residual is that of the prepared tooth
    const Solid target = read_solid(options.target, voxel, options.mm_per_unit);
    keep_warnings(sheet, target.warnings);
    result.target = placed(target, result.original, options, "target", unused, sheet.notes,
                           c.surface_tolerance_mm);
  }

  report_progress(options, "comparing volumes", 0.4);
  const double resolution =
      std::max({c.coarser_voxel_mm, c.cut_label_spacing, c.original_label_spacing / 2,
                std::sqrt(2.0) * c.scan_half_width});
  const VolumeComparison volumes =
      compare_volumes(result.original, result.prepared, result.target ? &*result.target : nullptr,
                      c.surface_tolerance_mm);
  c.pulp_exposed = volumes.pulp_exposed;
  add_volumes(sheet.quantities, volumes, resolution, surface_shift_mm(c, prepared));
  add_body_damage(result.original, result.prepared, resolution, c.surface_tolerance_mm,
                  sheet.quantities);
  if (result.target) {
    DeviationOptions deviation;
    deviation.cut_tolerance_mm =
        std::max(c.surface_tolerance_mm, cut_tolerance(result.original.tooth.lattice));
    result.deviation =
        measure_deviation(result.original, result.prepared, *result.target, deviation);
    add_deviation(sheet.quantities, *result.deviation, resolution);
  }
  return c;
}

}  // namespace

Assessment compare_teeth(const AssessmentOptions& options) { return compared(options).assessment; }

Assessment assess(const AssessmentOptions& options) {
  if (options.rubric && options.type && type_named(options.rubric->type) != *options.type)
    throw Error("the rubric '" + options.rubric->name + "' is for the type " +
                options.rubric->type + ", not " +
                std::string(kPreparationTypes[static_cast<std::size_t>(*options.type)]) +
                "; choose another rubric");
  for (const std::string& file : options.traces) regular_file_size(file);

  Compared c = compared(options);
  Assessment& result = c.assessment;
  ScoreSheet& sheet = result.sheet;
  report_progress(options, "measuring the preparation", 0.6);
  // Geometry is measured on facets of about a voxel, which neither a mesh nor a sharp edge need
  // have.
  const bool has_such_facets = result.prepared.layered && !result.prepared.tooth.parts;
  result.preparation_surface = has_such_facets && c.surface_tolerance_mm == 0
                                   ? result.prepared.surface
                                   : extract_surface(result.prepared.tooth, SurfaceOf::kAll);
  PreparationOptions preparation = options.preparation;
  preparation.original_label_spacing = c.original_label_spacing;
  preparation.cut_label_spacing = c.cut_label_spacing;
  preparation.cut_half_width = c.scan_half_width;
  preparation.cut_tolerance = c.surface_tolerance_mm;
  preparation.type = choose_type(options, result, preparation, sheet);
  sheet.type = kPreparationTypes[static_cast<std::size_t>(preparation.type)];
  result.preparation =
      measure_preparation(result.original.tooth, result.prepared.tooth, result.preparation_surface,
                          preparation, result.target ? &result.target->tooth : nullptr);
  for (Quantity q : result.preparation.quantities) {
    if (q.key == "pulp_exposed" && c.pulp_exposed) q.value = 1;
    sheet.quantities.push_back(std::move(q));
  }
  sheet.absent = result.preparation.absent;
  sheet.axis = result.preparation.frame.d;
  sheet.axis_from = result.preparation.frame.axis_source;
  sheet.axis_known = result.preparation.frame.axis_known();
  sheet.axis_uncertainty_deg = result.preparation.frame.axis_uncertainty_deg;
  sheet.notes.insert(sheet.notes.end(), result.preparation.notes.begin(),
                     result.preparation.notes.end());

  for (std::size_t n = 0; n < options.traces.size(); ++n)
    add_input(sheet, n == 0 ? "trace" : fmt::format("trace_{}", n + 1), options.traces[n]);
  if (!options.traces.empty()) keep_warnings(sheet, add_process(options, result, sheet.quantities));
  add_what_is_not_there(result, sheet);

  if (options.rubric) judge_sheet(*options.rubric, sheet);
  report_progress(options, "done", 1.0);
  return std::move(result);
}

Assessment assess_by_rubric(AssessmentOptions options, const std::string& rubric,
                            const std::string& rubrics_folder) {
  const auto shipped = [&](const std::string& type) {
    return rubrics_folder + "/" + type + ".toml";
  };
  std::string file = rubric;
  if (file.empty() && options.type)
    file = shipped(std::string(kPreparationTypes[static_cast<std::size_t>(*options.type)]));
  if (!file.empty() && file != "none") options.rubric = read_rubric(file);
  Assessment assessment = assess(options);
  ScoreSheet& sheet = assessment.sheet;
  if (file.empty()) {  // the type had to be found
    file = shipped(sheet.type);
    judge_sheet(read_rubric(file), sheet);
  }
  if (file != "none")
    sheet.inputs.push_back({"rubric",
                            rubric.empty() ? "the shipped rubric for " + sheet.type : rubric,
                            sha256_of_file(file)});
  return assessment;
}

}  // namespace toothprep
