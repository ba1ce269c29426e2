// toothprep score: what a prepared cavity or crown is worth, and why.
#include <fmt/format.h>

#include <algorithm>
#include <iostream>
#include <memory>
#include <optional>

#include "command.h"
#include "mesh_unit.h"
#include "progress_line.h"
#include "score_report.h"
#include "session_options.h"
#include "strictness.h"
#include "toothprep/build_info.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/outputs.h"
#include "toothprep/tools/score/assess.h"
#include "toothprep/tools/score/definitions.h"
#include "toothprep/version.h"

namespace toothprep::app {
namespace {

struct Options {
  std::string output, report, rubric, type, length_unit;
  std::vector<double> axis, mesial, buccal;
  bool json = false, list = false, force = false, strict = false;
  AssessmentOptions assessment;
};

std::optional<Vec3> direction(const std::vector<double>& given) {
  if (given.empty()) return {};
  return Vec3(given[0], given[1], given[2]);
}

void list_quantities() {
  for (const QuantityDefinition& d : quantity_definitions()) {
    std::string key = d.key;
    for (std::size_t n = 0; n < d.members.size(); ++n)
      key += (n == 0 ? ".{" : ",") + d.members[n] + (n + 1 == d.members.size() ? "}" : "");
    std::cout << key << "  [" << d.unit << "]\n    " << d.definition << '\n';
  }
}

void print(const Assessment& assessment, const Common& common) {
  const ScoreSheet& sheet = assessment.sheet;
  for (const std::string& note : sheet.notes) say(common, "note: " + note);
  if (!sheet.result) return;
  for (const CriterionResult& c : sheet.result->criteria)
    if (c.of > 0)
      say(common, fmt::format("  {:5.1f} of {:4.1f}  ", c.points, c.of) +
                      (c.reason.empty() ? c.criterion.name : c.reason));
  if (sheet.result->points_percent)
    say(common, sheet.result->name +
                    fmt::format(": {:.0f} % (to pass: {:.0f} %), ", *sheet.result->points_percent,
                                sheet.result->pass_points) +
                    (sheet.result->passed ? "passed" : "failed"));
  for (const std::string& reason : sheet.result->fail_reasons) say(common, "  " + reason);
}

void run(Options o, const Common& common) {
  if (o.list) {
    list_quantities();
    return;
  }
  AssessmentOptions& a = o.assessment;
  if (a.original.empty() || a.prepared.empty() || o.output.empty())
    throw CLI::ValidationError("score", "needs --original, --prepared and --output");
  if (!o.type.empty())
    a.type = static_cast<PreparationType>(
        std::find(kPreparationTypes.begin(), kPreparationTypes.end(), o.type) -
        kPreparationTypes.begin());
  a.mm_per_unit = mm_per_mesh_unit(o.length_unit);
  a.preparation.occlusal = direction(o.axis);
  a.preparation.mesial = direction(o.mesial);
  a.preparation.buccal = direction(o.buccal);

  Outputs outputs(o.force);
  outputs.reads({a.original, a.prepared, a.target, o.rubric});
  outputs.reads(a.traces);
  const std::string output = outputs.file(o.output, {".json"});
  const std::string report = outputs.optional_folder(o.report);
  outputs.begin();

  ProgressLine progress(common);
  a.progress = progress.report();
  Assessment assessment = assess_by_rubric(a, o.rubric, data_folder() + "/rubrics");
  assessment.sheet.toothprep_version = kVersion;
  assessment.sheet.build = build_text();

  warn_or_refuse(assessment.sheet.warnings, o.strict);
  write_score(assessment.sheet, output);
  if (!report.empty()) write_score_report(assessment, a.process, report, progress.report());
  outputs.publish();
  if (o.json) std::cout << score_json(assessment.sheet);
  print(assessment, common);
  say(common, o.output + (report.empty() ? std::string() : ", " + o.report + "/report.html"));
}

}  // namespace

void add_score(CLI::App& app, const Common& common) {
  auto* sub = app.add_subcommand("score", "Figures and points of a prepared cavity or crown");
  const auto o = std::make_shared<Options>();
  AssessmentOptions& a = o->assessment;
  sub->add_option("--original", a.original,
                  "The tooth before: .vdb, or a mesh; an open scan is closed");
  sub->add_option("--prepared", a.prepared,
                  "The tooth after: .vdb, or a mesh; an open scan is closed");
  sub->add_option("--target", a.target, "What it should have become: .vdb, or a mesh");
  sub->add_option(
         "--trace", a.traces,
         "Recording of the work (.h5): adds time, forces, stalls; of several burs one each, "
         "in the order of the work")
      ->allow_extra_args(false);
  sub->add_option("-o,--output", o->output, "Figures and points to write (.json)");
  sub->add_option("--report", o->report,
                  "Folder to write: report.html (complete in itself), thumbnail.png, prepared.ply, "
                  "with a target "
                  "deviation.ply and .vtk");
  sub->add_option("--type", o->type, "Kind of preparation; default: the rubric's, or found")
      ->check(CLI::IsMember(
          std::vector<std::string>(kPreparationTypes.begin(), kPreparationTypes.end())));
  sub->add_option(
      "--rubric", o->rubric,
      "Rubric (.toml; format in data/rubrics), or 'none'; default: the one shipped for the type");
  const auto vector = [&](const char* name, std::vector<double>& value, const char* text) {
    sub->add_option(name, value, text)->delimiter(',')->expected(3);
  };
  vector(
      "--axis", o->axis,
      "Occlusal direction X,Y,Z, out of the tooth; default: the tooth's frame (`orient`), in its "
      "file or estimated; where that isn't known it is guessed from the cut, and no verdict is "
      "certain");
  vector("--mesial", o->mesial, "Mesial direction X,Y,Z; default: the tooth's frame, or unnamed");
  vector("--buccal", o->buccal, "Buccal direction X,Y,Z; default: the tooth's frame, or unnamed");
  sub->add_flag("--register", a.register_teeth,
                "Lay prepared and target on the original first: they are in frames of their own");
  sub->add_option("--voxel-mm", a.voxel, "Voxel size for an original that is a mesh")
      ->check(CLI::Range(0.01, 1.0))
      ->capture_default_str();
  add_mesh_unit(*sub, o->length_unit);
  sub->add_option("--undercut-threshold-mm", a.preparation.undercut_threshold,
                  "Undercuts shallower than this are taken for roughness")
      ->check(CLI::Range(0.0, 3.0))
      ->capture_default_str();
  sub->add_option("--force-limit-n", a.process.force_limit, "Time above this force is reported")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  sub->add_flag("--list-figures", o->list, "Print every figure with its definition, and stop");
  add_strict(*sub, o->strict, "a tooth that another program changed, or an implausible recording");
  sub->add_flag("--json", o->json, "Print the result on stdout, too");
  sub->add_flag("--force", o->force, "Replace existing outputs");
  sub->footer(
      "score.json holds, where they apply: removed_mm3 (by tissue), over_prepared_mm3,\n"
      "under_prepared_mm3, dice, deviation_mean_mm, deviation_rms_mm, deviation_p95_mm,\n"
      "hausdorff_mm, depth_mm, floor_flatness_mm, floor_tilt_deg, wall_angles_deg,\n"
      "convergence_deg, width_mm, length_mm, margin_width_mm, wall_height_mm,\n"
      "occlusal_reduction_mm, undercut_max_mm, undercut_area_mm2, remaining_dentin_min_mm,\n"
      "pulp_exposed, their uncertainties, and the points per criterion.\n"
      "Example: toothprep score --original tooth.vdb --prepared prepared.vdb --type class1 \\\n"
      "           --trace trace.h5 -o score.json --report score-report");
  sub->callback([o, &common] { run(*o, common); });
}

}  // namespace toothprep::app
