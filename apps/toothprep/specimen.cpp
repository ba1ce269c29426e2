// toothprep specimen: teeth and scans that are known exactly.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <functional>
#include <memory>

#include "command.h"
#include "toothprep/proof/specimen/arch.h"
#include "toothprep/proof/specimen/block.h"
#include "toothprep/proof/specimen/synthetic_scan.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/files/tooth_file.h"
#include "toothprep/tools/io/outputs.h"
#include "toothprep/tools/scan_files/image_file.h"

namespace toothprep::app {
namespace {

const std::vector<std::string> kImageFiles = {".nrrd", ".nii", ".nii.gz", ".mha"};

struct ToothOptions {
  std::string output;
  bool force = false;
  std::vector<double> size = {8};
  BlockOptions block;
  ArchOptions molar;
};

struct ScanOptions {
  std::string output, labels;
  bool force = false;
  std::vector<double> spacing = {0.15};
  SyntheticScanOptions scan;
};

// One value for all three axes, or one each.
Vec3 three(const std::vector<double>& values, const char* option) {
  if (values.size() == 1) return Vec3::Constant(values[0]);
  if (values.size() == 3) return Vec3(values[0], values[1], values[2]);
  throw CLI::ValidationError(option, "needs one value or three, as X,Y,Z");
}

std::string volumes(const LayeredTooth& tooth) {
  const auto volume = remaining_volumes_mm3(tooth);
  std::string text;
  for (int k = 0; k < kTissueCount; ++k)
    if (volume[k] > 0)
      text += fmt::format("{}{} {:g} mm^3", text.empty() ? "" : ", ", kTissueNames[k], volume[k]);
  return text;
}

void write(const std::function<LayeredTooth()>& make, const ToothOptions& o, const Common& common) {
  Outputs outputs(o.force);
  const std::string output = outputs.file(o.output, {".vdb"});
  outputs.begin();
  const LayeredTooth tooth = make();
  write_tooth(tooth, output);
  outputs.publish();
  say(common, o.output + ": " + volumes(tooth));
}

void run_block(const ToothOptions& o, const Common& common) {
  BlockOptions block = o.block;
  block.size = three(o.size, "--size-mm");
  const auto make = [&] {
    LayeredTooth tooth = make_block(block);
    tooth.provenance["source"] = "specimen block";
    tooth.provenance["axis_occlusal"] = "0 1 0";
    return tooth;
  };
  write(make, o, common);
}

void run_molar(const ToothOptions& o, const Common& common) {
  write([&] { return make_arch(o.molar); }, o, common);
}

// A DICOM series goes into a folder; what has the extension of an image file is one, and another
// extension is more likely a mistake than a folder's name.
bool is_series(const std::string& path) {
  for (const std::string& extension : kImageFiles)
    if (path.ends_with(extension)) return false;
  const std::string extension = std::filesystem::path(path).extension().string();
  const bool odd = extension.size() > 1 && std::all_of(extension.begin() + 1, extension.end(),
                                                       [](unsigned char c) { return isalpha(c); });
  std::error_code error;
  if (odd && !std::filesystem::is_directory(path, error))
    throw InputError(path, "", "'" + extension + "' is no image format that is written here",
                     "use .nrrd, .nii, .nii.gz, .mha, or the name of a folder for a DICOM series");
  return true;
}

void run_scan(const ScanOptions& o, const Common& common) {
  SyntheticScanOptions options = o.scan;
  options.spacing = three(o.spacing, "--spacing-mm");
  const bool series = is_series(o.output);
  Outputs outputs(o.force);
  const std::string output =
      series ? outputs.folder(o.output) : outputs.file(o.output, kImageFiles);
  const std::string labels = outputs.optional_file(o.labels, kImageFiles);
  outputs.begin();
  const SyntheticScan scan = make_molar_scan(options);
  if (series)
    write_dicom_series(scan.image, output);
  else
    write_image(scan.image, output);
  if (!labels.empty()) write_image(scan.labels, labels);
  outputs.publish();
  const Index3& n = scan.image.size;
  say(common, o.output + ": " + std::to_string(n.x()) + " x " + std::to_string(n.y()) + " x " +
                  std::to_string(n.z()) + " voxels" +
                  (labels.empty() ? std::string() : ", ground truth in " + o.labels));
}

void add_output(CLI::App* sub, std::string& output, bool& force, const std::string& what) {
  sub->add_option("-o,--output", output, what)->required();
  sub->add_flag("--force", force, "Replace an existing output");
}

void add_block(CLI::App& specimen, const Common& common) {
  auto* sub = specimen.add_subcommand("block", "A block of enamel on dentin");
  const auto o = std::make_shared<ToothOptions>();
  add_output(sub, o->output, o->force, "Tooth file to write (.vdb)");
  sub->add_option("--size-mm", o->size, "Edge length, or X,Y,Z; mm")
      ->delimiter(',')
      ->expected(1, 3)
      ->default_str("8");
  sub->add_option("--enamel-mm", o->block.enamel,
                  "Enamel below the top face, 0 to the block's height; mm")
      ->capture_default_str();
  sub->add_option("--voxel-mm", o->block.voxel, "Voxel size, mm")->capture_default_str();
  sub->footer(
      "The top face lies at y = 0, the block below it, centred in x and z.\n"
      "Example: toothprep specimen block -o block.vdb --size-mm 8 --enamel-mm 2");
  sub->callback([o, &common] { run_block(*o, common); });
}

void add_molar(CLI::App& specimen, const Common& common) {
  auto* sub = specimen.add_subcommand("molar", "An anatomical lower first molar");
  const auto o = std::make_shared<ToothOptions>();
  o->molar.neighbours = 0;
  add_output(sub, o->output, o->force, "Tooth file to write (.vdb)");
  sub->add_option("--voxel-mm", o->molar.tooth.voxel, "Voxel size, 0.02 to 0.5 mm")
      ->capture_default_str();
  sub->add_flag("--premolar", o->molar.tooth.premolar,
                "A premolar: two cusps, one root, 8.4 x 7 mm");
  sub->add_option("--worn-mm", o->molar.tooth.worn,
                  "So much worn off the highest cusp, flat; 0 to 4");
  sub->add_flag("--rootless", o->molar.tooth.rootless, "A crown alone, cut off below the neck");
  sub->add_option("--tilt-deg", o->molar.tooth.tilt_deg, "Leans so far towards mesial and buccal");
  sub->add_option(
         "--neighbours", o->molar.neighbours,
         "So many teeth beside it, as bodies of their own: 1 is 37 (distal), 2 also 35, 13 "
         "make a whole lower arch")
      ->default_str("0");
  sub->add_option("--gap-mm", o->molar.gap, "Between two teeth where they are nearest, 0.02 to 2")
      ->capture_default_str();
  sub->add_flag("--gum", o->molar.gum,
                "A ridge of 'other' about the roots: the gum's stand-in, a body of its own");
  sub->footer(
      "It stands as in a scanner: crown up (+z), buccal +x, mesial -y, all coordinates positive\n"
      "unless it is tilted.\n"
      "Examples: toothprep specimen molar -o molar.vdb --voxel-mm 0.1\n"
      "          toothprep specimen molar -o arch.vdb --neighbours 2 --gum");
  sub->callback([o, &common] { run_molar(*o, common); });
}

void add_scan(CLI::App& specimen, const Common& common) {
  auto* sub = specimen.add_subcommand("scan", "A synthetic CT of the molar, with its ground truth");
  const auto o = std::make_shared<ScanOptions>();
  add_output(sub, o->output, o->force,
             "Scan to write: .nrrd, .nii, .nii.gz, .mha, or a folder for a DICOM series");
  sub->add_option("--labels", o->labels,
                  "Ground truth to write: 0 air, 1 enamel, 2 dentin, 3 pulp at voxel centres");
  sub->add_option("--spacing-mm", o->spacing, "Voxel size, or X,Y,Z; mm")
      ->delimiter(',')
      ->expected(1, 3)
      ->default_str("0.15");
  sub->add_option("--blur-voxels", o->scan.blur_fwhm_voxels,
                  "Full width at half maximum of the point spread function, voxels")
      ->capture_default_str();
  sub->add_option("--noise", o->scan.noise, "Standard deviation of the noise, grey values")
      ->capture_default_str();
  sub->add_option("--seed", o->scan.seed, "Seed of the noise")->capture_default_str();
  sub->footer(
      "Grey values: air -1000, pulp 300, dentin 1600, enamel 2500, clipped to -1024 .. 3071.\n"
      "Example: toothprep specimen scan -o scan.nrrd --labels labels.nrrd --noise 60");
  sub->callback([o, &common] { run_scan(*o, common); });
}

}  // namespace

void add_specimen(CLI::App& app, const Common& common) {
  auto* sub =
      app.add_subcommand("specimen", "Teeth, scans and measurements that are known exactly");
  sub->require_subcommand(1);
  add_block(*sub, common);
  add_molar(*sub, common);
  add_scan(*sub, common);
  add_measurement(*sub, common);
  add_cavity(*sub, common);
  sub->footer("Example: toothprep specimen molar -o molar.vdb");
}

}  // namespace toothprep::app
