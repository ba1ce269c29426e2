// A preparation scored.
#include "bindings.h"
#include "long_work.h"
#include "options.h"
#include "toothprep/build_info.h"
#include "toothprep/tools/score/assess.h"
#include "toothprep/version.h"

namespace toothprep::python {
namespace {

AssessmentOptions options_of(const py::dict& o) {
  AssessmentOptions a;
  a.original = taken<std::string>(o, "original");
  a.prepared = taken<std::string>(o, "prepared");
  a.target = taken<std::string>(o, "target");
  if (const auto trace = taken<std::string>(o, "trace"); !trace.empty()) a.traces = {trace};
  if (!o["type"].is_none()) {
    using Types = std::array<std::pair<const char*, PreparationType>, 3>;
    a.type = choice_taken(o, "type",
                          Types{{{"crown", PreparationType::kCrown},
                                 {"class1", PreparationType::kClass1},
                                 {"class2", PreparationType::kClass2}}});
  }
  a.register_teeth = taken<bool>(o, "register");
  a.voxel = taken<double>(o, "voxel_mm");
  a.preparation.occlusal = vector_taken(o, "axis");
  a.preparation.mesial = vector_taken(o, "mesial");
  a.preparation.buccal = vector_taken(o, "buccal");
  a.preparation.undercut_threshold = taken<double>(o, "undercut_threshold_mm");
  a.process.force_limit = taken<double>(o, "force_limit_n");
  return a;
}

std::string scored(const py::dict& options, const std::string& rubric,
                   const std::string& rubrics_folder, const py::object& progress) {
  AssessmentOptions asked = options_of(options);
  ScoreSheet sheet;
  std::string json;
  run_long(progress, [&](Progress& p) {
    asked.progress = [&](const std::string& stage, double done) { p.report(stage, done); };
    sheet = assess_by_rubric(asked, rubric, rubrics_folder).sheet;
    sheet.toothprep_version = kVersion;
    sheet.build = build_text();
    json = score_json(sheet);
  });
  warn(sheet.warnings);
  return json;
}

}  // namespace

void bind_score(py::module_& m) { m.def("score", &scored, "JSON of a score."); }

}  // namespace toothprep::python
