// toothprep voxelize: a CT scan, a segmentation or surface meshes to a layered tooth.
#include <fmt/format.h>

#include <chrono>
#include <iostream>
#include <memory>

#include "body_options.h"
#include "command.h"
#include "mesh_unit.h"
#include "progress_line.h"
#include "toothprep/build_info.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/tooth/combine_teeth.h"
#include "toothprep/tools/files/tooth_file.h"
#include "toothprep/tools/io/label_source.h"
#include "toothprep/tools/io/outputs.h"
#include "toothprep/tools/io/plain_text.h"
#include "toothprep/tools/mesh_files/mesh_file.h"
#include "toothprep/tools/orientation/estimate_frame.h"
#include "toothprep/tools/segmentation/hounsfield.h"
#include "toothprep/tools/segmentation/scan_report.h"
#include "toothprep/tools/segmentation/voxelize_file.h"
#include "toothprep/tools/segmentation/voxelize_json.h"
#include "toothprep/tools/shells/closing.h"
#include "toothprep/version.h"

namespace toothprep::app {
namespace {

struct Options {
  std::string scan, output;
  double voxel_mm = 0.1;
  std::vector<double> thresholds;
  std::string spacing_mm;
  std::vector<std::string> labels;      // tissue=value
  std::vector<std::string> bodies;      // name=values
  std::vector<std::string> neighbours;  // name=tooth
  std::vector<std::string> meshes;      // tissue=file, or a file with enamel_mm
  double enamel_mm = 0;                 // 0: not given
  std::string series, report, tooth, hounsfield, length_unit;
  std::vector<double> roi;  // mm
  int component = 0;        // 0: not given
  bool allow_irregular = false;
  bool repair = true, smooth_labels = true, thin_enamel = true, force = false, json = false;
};

std::map<std::uint16_t, Tissue> parse_labels(const std::vector<std::string>& texts) {
  std::map<std::uint16_t, Tissue> tissues;
  for (const std::string& text : texts) {
    const auto equals = text.find('=');
    const auto tissue = tissue_named(text.substr(0, equals));
    int value = 0;
    if (equals == std::string::npos || !tissue ||
        !CLI::detail::lexical_cast(text.substr(equals + 1), value) || value < 1 || value > 65535)
      throw CLI::ValidationError(
          "--labels",
          "'" + text + "' is not TISSUE=VALUE (enamel, dentin, pulp or other; 1..65535)");
    if (!tissues.emplace(static_cast<std::uint16_t>(value), *tissue).second)
      throw CLI::ValidationError("--labels",
                                 "the value " + std::to_string(value) + " is given twice");
  }
  return tissues;
}

// "S" or "X,Y,Z". One argument, lest the scan's name after it be taken for a number.
std::array<double, 3> parse_spacing(const std::string& text) {
  const auto parts = CLI::detail::split(text, ',');
  std::array<double, 3> spacing{};
  bool good = parts.size() == 1 || parts.size() == 3;
  for (std::size_t a = 0; a < 3 && good; ++a) {
    spacing[a] = decimal_number(parts[parts.size() == 1 ? 0 : a]).value_or(0);
    good = spacing[a] > 0;
  }
  if (!good)
    throw CLI::ValidationError("--spacing-mm",
                               "'" + text + "' is neither a positive number nor X,Y,Z");
  return spacing;
}

Box roi_of(const std::vector<double>& roi) {
  return {Vec3(roi[0], roi[2], roi[4]), Vec3(roi[1], roi[3], roi[5])};
}

std::string presets_file() { return data_folder() + "/scans/hounsfield.toml"; }

void print_presets() {
  for (const HounsfieldPreset& p : read_hounsfield_presets(presets_file()))
    std::cout << fmt::format("{:<18} {:6.0f} {:6.0f}  {}\n", p.name, p.pulp_dentin, p.dentin_enamel,
                             p.description);
  std::cerr << "Borders pulp|dentin and dentin|enamel, HU; sources stand in " << presets_file()
            << '\n';
}

// The file with the tooth's frame, lines on stderr, JSON on stdout.
void finish(LayeredTooth& tooth, const Options& options, const Common& common, Outputs& outputs,
            const std::string& output, std::chrono::steady_clock::time_point start,
            const std::vector<std::string>& notes, const VoxelizeReport* grey_scan = nullptr) {
  const ToothFrame frame = estimate_frame(tooth);
  record_frame(frame, tooth.provenance);
  write_tooth(tooth, output);
  outputs.publish();
  const auto volumes = remaining_volumes_mm3(tooth);
  const double seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  std::string line = options.output + ":";
  for (int t = 0; t < kTissueCount; ++t)
    if (volumes[t] > 0) line += fmt::format(" {} {:.2f} mm3,", kTissueNames[t], volumes[t]);
  say(common, line + fmt::format(" voxel {:.4g} mm, {:.1f} s", options.voxel_mm, seconds));
  say(common, "frame: " + frame_text(frame));
  for (const std::string& note : frame.notes) say(common, note);
  if (options.json)
    std::cout << voxelize_json(tooth, options.output, seconds, notes, {kVersion, build_text()},
                               grey_scan);
}

ShellReading reading_of(const Options& options) {
  ShellReading how;
  how.mm_per_unit = mm_per_mesh_unit(options.length_unit);
  if (!options.roi.empty()) how.roi = roi_of(options.roi);
  if (!options.tooth.empty()) parse_tooth(options.tooth, "--tooth", how.tooth, how.tooth_at);
  how.mend = options.repair;
  return how;
}

void run_meshes(const Options& options, const Common& common) {
  const auto start = std::chrono::steady_clock::now();
  const bool bare = options.enamel_mm > 0;
  if (bare && (options.meshes.size() != 1 || !is_mesh_file(options.meshes[0]) ||
               tissue_named(options.meshes[0].substr(0, options.meshes[0].find('=')))))
    throw CLI::ValidationError("--enamel-mm", "takes a single --mesh FILE without a tissue");
  const BodyMeshes meshes =
      bare ? BodyMeshes{{{"tooth", BodyKind::kTooth}}, {{{Tissue::kOther, options.meshes[0]}}}}
           : parse_body_meshes(options.meshes);
  const ShellReading reading = reading_of(options);
  const std::vector<NeighbourChoice> neighbours = parse_neighbours(options.neighbours);
  if (!neighbours.empty() && meshes.list.size() > 1)
    throw CLI::ValidationError("--neighbour", "is not for meshes that name their bodies");
  Outputs outputs(options.force);
  for (const auto& files : meshes.parts)
    for (const auto& [tissue, file] : files) outputs.reads({file});
  const std::string output = outputs.file(options.output, {".vdb"});
  outputs.begin();
  ProgressLine progress(common);
  ShellOptions how;
  how.voxel = options.voxel_mm;
  how.progress = progress.report();
  how.announce = [&](const std::string& work) { say(common, work); };
  std::vector<std::string> notes;
  const auto read = [&](const ShellReading& one) {
    return bare ? voxelize_bare_shell(options.meshes[0], options.enamel_mm, one, how, notes)
                : voxelize_shell_files(meshes.parts[0], one, how, notes);
  };
  LayeredTooth tooth = meshes.list.size() > 1
                           ? voxelize_shell_bodies(meshes.list, meshes.parts, reading, how, notes)
                           : read(reading);
  if (!neighbours.empty()) {
    std::vector<LayeredTooth> teeth;
    teeth.push_back(std::move(tooth));
    std::vector<Body> list = meshes.list;
    for (const NeighbourChoice& neighbour : neighbours) {
      ShellReading one = reading;
      one.tooth = neighbour.tooth;
      one.tooth_at = neighbour.tooth_at;
      teeth.push_back(read(one));
      list.push_back(neighbour.body);
    }
    tooth = combine_teeth(teeth, list);
  }
  for (const auto& note : notes) warn(note);
  finish(tooth, options, common, outputs, output, start, notes);
}

ScanJob job_of(const Options& options) {
  ScanJob job;
  job.path = options.scan;
  job.tissues = parse_labels(options.labels);
  job.bodies = parse_body_labels(options.bodies, job.tissues);
  if (!options.spacing_mm.empty()) job.reading.spacing_mm = parse_spacing(options.spacing_mm);
  job.reading.series = options.series;
  job.reading.allow_irregular = options.allow_irregular;
  if (options.component > 0) job.reading.component = options.component;
  if (!options.roi.empty()) job.roi = roi_of(options.roi);
  job.how.voxel = options.voxel_mm;
  if (!options.thresholds.empty())
    job.how.thresholds = {options.thresholds[0], options.thresholds[1]};
  if (!options.tooth.empty())
    parse_tooth(options.tooth, "--tooth", job.how.tooth, job.how.tooth_at);
  job.neighbours = parse_neighbours(options.neighbours);
  job.how.one_tooth = !options.tooth.empty();
  job.how.smooth_labels = options.smooth_labels;
  job.how.thin_enamel = options.thin_enamel;
  if (!options.hounsfield.empty()) {
    const auto presets = read_hounsfield_presets(presets_file());
    const HounsfieldPreset& preset = preset_named(presets, options.hounsfield);
    job.how.typical = {preset.pulp_dentin, preset.dentin_enamel};
  }
  return job;
}

void say_greys(const Options& options, const Common& common, const VoxelizeReport& report) {
  say(common,
      fmt::format(
          "thresholds {:.4g} (dentin), {:.4g} (enamel){}; grey values: surroundings {:.4g}, dentin "
          "{:.4g}, enamel {:.4g}",
          report.threshold_dentin, report.threshold_enamel,
          options.thresholds.empty() ? ", automatic" : "", report.surroundings, report.dentin,
          report.enamel));
}

void say_labels(const Common& common, const LayeredTooth& tooth) {
  const std::optional<LabelSource> labels = recorded_labels(tooth.provenance);
  if (!labels) return;
  say(common, fmt::format("surfaces from labels of {:.4g} mm, {}", labels->spacing_mm,
                          labels->smooth ? "without their steps (--no-smooth-labels keeps them)"
                                         : "with their steps"));
}

void run_scan(const Options& options, const Common& common) {
  const auto start = std::chrono::steady_clock::now();
  ScanJob job = job_of(options);
  Outputs outputs(options.force);
  outputs.reads({options.scan});
  const std::string output = outputs.file(options.output, {".vdb"});
  const std::string report_folder = outputs.optional_folder(options.report);
  outputs.begin();
  if (!report_folder.empty() && !run_script("plot-scan-report", {"--check"}))
    throw Error("plot-scan-report cannot run; install python3-numpy and python3-matplotlib");
  ProgressLine progress(common);
  job.how.progress = progress.report();
  job.how.announce = [&](const std::string& work) { say(common, options.scan + ": " + work); };
  job.how.keep_greys = !report_folder.empty();
  auto [tooth, report] = voxelize_file(job);
  if (!report_folder.empty()) {
    write_scan_report(report_folder, tooth, report, kVersion, build_text());
    if (!run_script("plot-scan-report", {report_folder})) throw Error("plot-scan-report failed");
  }
  for (const auto& note : report.notes) warn(options.scan + ": " + note);
  const bool grey = job.tissues.empty();
  if (grey)
    say_greys(options, common, report);
  else
    say_labels(common, tooth);
  finish(tooth, options, common, outputs, output, start, report.notes, grey ? &report : nullptr);
}

void run(const Options& options, const Common& common) {
  if (options.hounsfield == "list") {
    print_presets();
    return;
  }
  if (options.output.empty()) throw CLI::RequiredError("--output");
  if (options.scan.empty() == options.meshes.empty())
    throw CLI::ValidationError("voxelize", options.meshes.empty()
                                               ? "needs a scan or --mesh TISSUE=FILE"
                                               : "takes a scan or --mesh, not both");
  if (options.meshes.empty() && !options.length_unit.empty())
    throw CLI::ValidationError("--length-unit", "is for --mesh; a scan has --spacing-mm");
  if (options.meshes.empty() && options.enamel_mm > 0)
    throw CLI::ValidationError("--enamel-mm", "is for --mesh");
  if (options.meshes.empty())
    run_scan(options, common);
  else
    run_meshes(options, common);
}

void add_mesh_options(CLI::App& sub, Options& options) {
  sub.add_option("--mesh", options.meshes,
                 "In place of a scan, surfaces (.stl .ply .obj .off, .gz of these), one per "
                 "option: enamel=FILE, dentin=FILE, pulp=FILE, other=FILE; where they overlap the "
                 "inner tissue wins. NAME[:KIND]/enamel=FILE and so on are of another body (a "
                 "neighbour, gum). Small faults are mended and open sides closed, with warnings")
      ->allow_extra_args(false)
      ->excludes("--labels")
      ->excludes("--thresholds")
      ->excludes("--hounsfield")
      ->excludes("--spacing-mm")
      ->excludes("--thin-enamel");
  sub.add_option("--enamel-mm", options.enamel_mm,
                 "Layers for a single --mesh FILE that has none, by a model: enamel of this "
                 "thickness, thinning out towards an open neck; no pulp")
      ->check(CLI::Range(0.1, 5.0));
  add_mesh_unit(sub, options.length_unit);
}

}  // namespace

void add_voxelize(CLI::App& app, const Common& common) {
  const auto options = std::make_shared<Options>();
  CLI::App* sub = app.add_subcommand(
      "voxelize",
      "A CT scan (DICOM series, NRRD, NIfTI, MetaImage), a segmentation or surface meshes to a "
      "layered tooth");
  sub->add_option(
      "scan", options->scan,
      "Folder with a DICOM series, or .dcm (multi-frame) .nrrd .nhdr .nii .nii.gz .mha .mhd");
  sub->add_option("-o,--output", options->output, "Tooth file (.vdb)");
  sub->add_option("--voxel-mm", options->voxel_mm, "Voxel size of the tooth, mm")
      ->check(CLI::Range(1e-3, 10.0))
      ->capture_default_str();
  sub->add_option("--thresholds", options->thresholds,
                  "Grey values of the borders surroundings|dentin and dentin|enamel: DENTIN,ENAMEL "
                  "(absent: found in the histogram)")
      ->delimiter(',')
      ->expected(2)
      ->allow_extra_args(false);
  sub->add_option("--hounsfield", options->hounsfield,
                  "Of a scan in Hounsfield units: separate the tissues by a preset's borders "
                  "('list' prints them) instead of by the histogram's peaks")
      ->excludes("--thresholds");
  sub->add_option(
      "--tooth", options->tooth,
      "Of several teeth in a scan, a segmentation or a mesh: N (1 is the largest), or a "
      "place in it X,Y,Z in mm, LPS");
  sub->add_option("--spacing-mm", options->spacing_mm,
                  "Voxel size of the scan, mm, in place of the file's: S or X,Y,Z");
  sub->add_option("--labels", options->labels,
                  "The input is a segmentation: enamel=2,dentin=3[,pulp=4][,other=1]; values not "
                  "named are empty")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->excludes("--thresholds")
      ->excludes("--hounsfield");
  add_body_option(*sub, options->bodies);
  add_neighbour_option(*sub, options->neighbours);
  sub->add_flag("--smooth-labels,!--no-smooth-labels", options->smooth_labels,
                "Surfaces of a segmentation without the steps of its voxels, each voxel's centre "
                "staying in its tissue (the default); --no-smooth-labels keeps the steps")
      ->needs("--labels");
  sub->add_flag("--thin-enamel,!--no-thin-enamel", options->thin_enamel,
                "Of a scan: find enamel down to about one scan voxel by the greys along the "
                "surface's normal (the default); --no-thin-enamel goes by thresholds only")
      ->excludes("--labels");
  add_mesh_options(*sub, *options);
  sub->add_option(
         "--series", options->series,
         "Of a folder with several DICOM series, the one by its place in the list, number, "
         "UID or description")
      ->excludes("--mesh");
  sub->add_flag("--allow-irregular", options->allow_irregular,
                "Resample missing or uneven slices and a tilted gantry, and read slices that are "
                "stored in different ways each by its own header, instead of refusing them")
      ->excludes("--mesh");
  sub->add_option("--component", options->component,
                  "Of an image with several components, or a 4-D one, the one to take (1 is the "
                  "first)")
      ->check(CLI::Range(1, 65535))
      ->excludes("--mesh");
  sub->add_option("--roi", options->roi,
                  "Only this part of the scan or mesh: XMIN,XMAX,YMIN,YMAX,ZMIN,ZMAX in mm, LPS")
      ->delimiter(',')
      ->expected(6)
      ->allow_extra_args(false);
  sub->add_option("--report", options->report,
                  "Also make a folder with the histogram, three slices with the tissues' outlines, "
                  "volumes and the enamel's thickness")
      ->excludes("--mesh");
  sub->add_flag("--repair,!--no-repair", options->repair,
                "Mend and close meshes where that invents no shape, and say what was done (the "
                "default); --no-repair refuses them")
      ->needs("--mesh");
  sub->add_flag("--force", options->force, "Replace an existing output");
  sub->add_flag("--json", options->json, "Thresholds, volumes and hashes on stdout as JSON");
  sub->footer(
      "Examples:\n"
      "  toothprep voxelize scan.nrrd -o tooth.vdb --spacing-mm 0.12\n"
      "  toothprep voxelize dicom-folder -o tooth.vdb --voxel-mm 0.05 --thresholds 900,1900\n"
      "  toothprep voxelize jaw-ct -o tooth.vdb --hounsfield young-permanent --tooth 12.5,-40,31\n"
      "  toothprep voxelize segmentation.nii.gz -o tooth.vdb --labels enamel=2,dentin=3,other=1\n"
      "  toothprep voxelize jaw.nrrd -o tooth.vdb --labels enamel=2,dentin=3,enamel=5,dentin=6 "
      "--body 37=5,6\n"
      "  toothprep voxelize --mesh enamel=crown.stl --mesh dentin=dentin.stl -o tooth.vdb\n"
      "  toothprep voxelize --mesh arch.ply.gz --tooth 12,-4,3 --enamel-mm 1.5 -o tooth.vdb\n"
      "  toothprep voxelize jaw-ct -o tooth.vdb --tooth 12.5,-40,31 --neighbour 37=14,-31,30");
  sub->callback([options, &common] { run(*options, common); });
}

}  // namespace toothprep::app
