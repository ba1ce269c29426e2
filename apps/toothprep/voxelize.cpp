// toothprep voxelize: a CT scan or a segmentation to a layered tooth.
#include "toothprep/scan/voxelize.h"

#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "command.h"
#include "toothprep/core/errors.h"
#include "toothprep/core/output_file.h"
#include "toothprep/scan/image_file.h"
#include "toothprep/toothfile/tooth_file.h"

namespace toothprep::app {
namespace {

struct Options {
  std::string scan, output;
  double voxel_mm = 0.1;
  std::vector<double> thresholds;
  std::string spacing_mm;
  std::vector<std::string> labels;  // tissue=value
  bool force = false, json = false;
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
  for (std::size_t a = 0; a < 3 && good; ++a)
    good =
        CLI::detail::lexical_cast(parts[parts.size() == 1 ? 0 : a], spacing[a]) && spacing[a] > 0;
  if (!good)
    throw CLI::ValidationError("--spacing-mm",
                               "'" + text + "' is neither a positive number nor X,Y,Z");
  return spacing;
}

std::string format(const char* pattern, auto... values) {
  std::array<char, 512> text{};
  std::snprintf(text.data(), text.size(), pattern, values...);
  return text.data();
}

void warn_placeholder(const Options& options, const Vec3& spacing) {
  if (options.spacing_mm.empty() && spacing == Vec3::Ones())
    warn(options.scan +
         ": a spacing of 1 x 1 x 1 mm looks like a placeholder; give the true voxel size with "
         "--spacing-mm");
}

void run(const Options& options, const Common& common) {
  const auto start = std::chrono::steady_clock::now();
  const auto tissues = parse_labels(options.labels);
  std::optional<std::array<double, 3>> spacing;
  if (!options.spacing_mm.empty()) spacing = parse_spacing(options.spacing_mm);
  OutputFile out(options.output, options.force);

  VoxelizeOptions how;
  how.voxel = options.voxel_mm;
  if (!options.thresholds.empty()) how.thresholds = {options.thresholds[0], options.thresholds[1]};
  const bool terminal = isatty(STDERR_FILENO) != 0 && !common.quiet;
  if (terminal)
    how.progress = [](const std::string& stage, double done) {
      if (done < 1)
        std::cerr << format("\r%3.0f %%  %-30s", 100 * done, stage.c_str()) << std::flush;
      else
        std::cerr << format("\r%-38s\r", "") << std::flush;
    };

  LayeredTooth tooth;
  VoxelizeReport report;
  const std::string name =
      std::filesystem::path(options.scan).lexically_normal().filename().empty()
          ? std::filesystem::path(options.scan).lexically_normal().parent_path().filename().string()
          : std::filesystem::path(options.scan).filename().string();
  try {
    if (tissues.empty()) {
      const ImageVolume<float> scan = read_scan(options.scan, spacing);
      warn_placeholder(options, scan.spacing);
      tooth = voxelize_scan(scan, how, &report);
    } else {
      const ImageVolume<std::uint16_t> labels = read_label_image(options.scan, spacing);
      warn_placeholder(options, labels.spacing);
      tooth = voxelize_labels(labels, tissues, how, &report);
    }
  } catch (const InputError&) {
    if (terminal) std::cerr << '\n';
    throw;
  } catch (const Error& e) {  // says what; the file is known here
    if (terminal) std::cerr << '\n';
    throw InputError(options.scan, "", e.what());
  }
  const std::string source_sha256 = sha256_of_scan(options.scan);
  tooth.provenance["source"] = name;
  tooth.provenance["source_sha256"] = source_sha256;
  write_tooth(tooth, out.temporary());
  out.commit();

  for (const auto& note : report.notes) warn(options.scan + ": " + note);
  const auto volumes = remaining_volumes_mm3(tooth);
  const double seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  if (tissues.empty())
    say(common,
        format("thresholds %.4g (dentin), %.4g (enamel)%s; grey values: surroundings %.4g, dentin "
               "%.4g, enamel %.4g",
               report.threshold_dentin, report.threshold_enamel,
               options.thresholds.empty() ? ", automatic" : "", report.surroundings, report.dentin,
               report.enamel));
  std::string line = options.output + ":";
  for (int t = 0; t < kTissueCount; ++t)
    if (volumes[t] > 0)
      line += format(" %s %.2f mm3,", std::string(kTissueNames[t]).c_str(), volumes[t]);
  say(common, line + format(" voxel %.4g mm, %.1f s", options.voxel_mm, seconds));
  if (options.json) {
    nlohmann::json json = {{"schema", "toothprep-voxelize"},
                           {"schema_version", 1},
                           {"source", name},
                           {"source_sha256", source_sha256},
                           {"tooth", options.output},
                           {"tooth_sha256", tooth_sha256(tooth)},
                           {"voxel_mm", options.voxel_mm},
                           {"seconds", seconds}};
    for (int t = 0; t < kTissueCount; ++t)
      json["volume_mm3"][std::string(kTissueNames[t])] = volumes[t];
    if (tissues.empty()) {
      json["threshold_dentin"] = report.threshold_dentin;
      json["threshold_enamel"] = report.threshold_enamel;
      json["grey_surroundings"] = report.surroundings;
      json["grey_dentin"] = report.dentin;
      json["grey_enamel"] = report.enamel;
    }
    json["notes"] = report.notes;
    std::cout << json.dump(2) << '\n';
  }
}

}  // namespace

void add_voxelize(CLI::App& app, const Common& common) {
  const auto options = std::make_shared<Options>();
  CLI::App* sub = app.add_subcommand(
      "voxelize",
      "A CT scan (DICOM series, NRRD, NIfTI, MetaImage) or a segmentation to a layered tooth");
  sub->add_option("scan", options->scan,
                  "Folder with one DICOM series, or .nrrd .nhdr .nii .nii.gz .mha .mhd")
      ->required();
  sub->add_option("-o,--output", options->output, "Tooth file (.vdb)")->required();
  sub->add_option("--voxel-mm", options->voxel_mm, "Voxel size of the tooth, mm")
      ->check(CLI::Range(1e-3, 10.0))
      ->capture_default_str();
  sub->add_option("--thresholds", options->thresholds,
                  "Grey values of the borders surroundings|dentin and dentin|enamel: DENTIN,ENAMEL "
                  "(absent: found in the histogram)")
      ->delimiter(',')
      ->expected(2)
      ->allow_extra_args(false);
  sub->add_option("--spacing-mm", options->spacing_mm,
                  "Voxel size of the scan, mm, in place of the file's: S or X,Y,Z");
  sub->add_option("--labels", options->labels,
                  "The input is a segmentation: enamel=2,dentin=3[,pulp=4][,other=1]; values not "
                  "named are empty")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->excludes("--thresholds");
  sub->add_flag("--force", options->force, "Replace an existing output");
  sub->add_flag("--json", options->json, "Thresholds, volumes and hashes on stdout as JSON");
  sub->footer(
      "Examples:\n"
      "  toothprep voxelize scan.nrrd -o tooth.vdb --spacing-mm 0.12\n"
      "  toothprep voxelize dicom-folder -o tooth.vdb --voxel-mm 0.05 --thresholds 900,1900\n"
      "  toothprep voxelize segmentation.nii.gz -o tooth.vdb --labels enamel=2,dentin=3,other=1");
  sub->callback([options, &common] { run(*options, common); });
}

}  // namespace toothprep::app
