// A scan, a segmentation or shells to a tooth.
#include <chrono>

#include "bindings.h"
#include "long_work.h"
#include "options.h"
#include "toothprep/build_info.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/orientation/estimate_frame.h"
#include "toothprep/tools/segmentation/hounsfield.h"
#include "toothprep/tools/segmentation/voxelize_file.h"
#include "toothprep/tools/segmentation/voxelize_json.h"
#include "toothprep/tools/shells/closing.h"
#include "toothprep/version.h"

namespace toothprep::python {
namespace {

Tissue tissue_of(const std::string& name) {
  if (const auto tissue = tissue_named(name)) return *tissue;
  throw py::value_error("no tissue '" + name + "'; there are enamel, dentin, pulp and other");
}

// A number (1 is the largest), a place (mm, W), or None: as it is.
template <class How>
void choose_tooth(const py::dict& options, const char* key, How& how) {
  if (py::isinstance<py::int_>(options[key]))
    how.tooth = taken<int>(options, key);
  else
    how.tooth_at = vector_taken(options, key);
}

ScanJob job_of(const py::dict& o, const std::string& presets) {
  ScanJob job;
  job.path = path_of(o["source"]);
  if (const auto labels = taken<std::optional<std::map<std::string, int>>>(o, "labels"))
    for (const auto& [name, value] : *labels) {
      if (value < 1 || value > 65535) throw py::value_error("labels are 1 to 65535");
      if (!job.tissues.emplace(static_cast<std::uint16_t>(value), tissue_of(name)).second)
        throw py::value_error("the label " + std::to_string(value) + " is given twice");
    }
  if (const auto spacing = vector_taken(o, "spacing_mm"))
    job.reading.spacing_mm = {spacing->x(), spacing->y(), spacing->z()};
  job.reading.series = taken<std::string>(o, "series");
  job.reading.allow_irregular = taken<bool>(o, "allow_irregular");
  job.reading.component = taken<std::optional<int>>(o, "component");
  if (const auto roi = taken<std::optional<std::array<std::array<double, 3>, 2>>>(o, "roi_mm"))
    job.roi = Box{Vec3((*roi)[0].data()), Vec3((*roi)[1].data())};
  job.how.voxel = taken<double>(o, "voxel_mm");
  job.how.smooth_labels = taken<bool>(o, "smooth_labels");
  job.how.thresholds = taken<std::optional<std::array<double, 2>>>(o, "thresholds");
  choose_tooth(o, "tooth", job.how);
  job.how.one_tooth = !o["tooth"].is_none();
  if (!o["neighbours"].is_none()) {
    const auto neighbours = taken<py::dict>(o, "neighbours");
    for (const auto& [name, tooth] : neighbours) {
      NeighbourChoice& one = job.neighbours.emplace_back();
      one.body = {py::str(name), BodyKind::kNeighbour};
      choose_tooth(py::dict(py::arg("neighbours") = tooth), "neighbours", one);
    }
  }
  if (const auto name = taken<std::optional<std::string>>(o, "hounsfield")) {
    const auto known = read_hounsfield_presets(presets);
    const HounsfieldPreset& preset = preset_named(known, *name);
    job.how.typical = {preset.pulp_dentin, preset.dentin_enamel};
  }
  return job;
}

struct Made {
  std::shared_ptr<Tooth> tooth;
  std::string json;
  std::vector<std::string> notes;
};

py::tuple handed_over(const Made& made) {
  warn(made.notes);
  return py::make_tuple(made.tooth, made.json);
}

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

py::tuple voxelize_scan_file(const py::dict& options, const std::string& presets,
                             const py::object& progress) {
  const auto start = std::chrono::steady_clock::now();
  ScanJob job = job_of(options, presets);
  Made made;
  run_long(progress, [&](Progress& p) {
    job.how.progress = [&](const std::string& stage, double done) { p.report(stage, done); };
    VoxelizedScan scan = voxelize_file(job);
    record_frame(estimate_frame(scan.tooth), scan.tooth.provenance);
    for (const std::string& note : scan.report.notes) made.notes.push_back(job.path + ": " + note);
    made.json =
        voxelize_json(scan.tooth, {}, seconds_since(start), scan.report.notes,
                      {kVersion, build_text()}, job.tissues.empty() ? &scan.report : nullptr);
    made.tooth = std::make_shared<Tooth>(std::move(scan.tooth));
  });
  return handed_over(made);
}

py::tuple voxelize_meshes(const py::dict& meshes, double voxel_mm, bool repair,
                          const py::object& chosen, const py::object& progress) {
  const auto start = std::chrono::steady_clock::now();
  std::vector<std::pair<Tissue, std::string>> files;
  for (const auto& [name, file] : meshes)
    files.emplace_back(tissue_of(py::cast<std::string>(name)),
                       path_of(py::reinterpret_borrow<py::object>(file)));
  ShellReading reading;
  reading.mend = repair;
  choose_tooth(py::dict(py::arg("tooth") = chosen), "tooth", reading);
  Made made;
  run_long(progress, [&](Progress& p) {
    ShellOptions how;
    how.voxel = voxel_mm;
    how.progress = [&](const std::string& stage, double done) { p.report(stage, done); };
    LayeredTooth tooth = voxelize_shell_files(files, reading, how, made.notes);
    record_frame(estimate_frame(tooth), tooth.provenance);
    made.json =
        voxelize_json(tooth, {}, seconds_since(start), made.notes, {kVersion, build_text()});
    made.tooth = std::make_shared<Tooth>(std::move(tooth));
  });
  return handed_over(made);
}

}  // namespace

void bind_voxelize(py::module_& m) {
  m.def("voxelize_scan", &voxelize_scan_file, "(tooth, JSON) of a scan or a segmentation.");
  m.def("voxelize_meshes", &voxelize_meshes, "(tooth, JSON) of shells.");
}

}  // namespace toothprep::python
