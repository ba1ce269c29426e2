#include "toothprep/tools/segmentation/voxelize_file.h"

#include <atomic>
#include <filesystem>
#include <future>
#include <memory>
#include <utility>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/tooth/combine_teeth.h"
#include "toothprep/tools/segmentation/crop.h"

namespace toothprep {
namespace {

// Of a folder too, whether or not a slash ends it.
std::string name_of(const std::string& path) {
  const std::filesystem::path normal = std::filesystem::path(path).lexically_normal();
  return normal.has_filename() ? normal.filename().string()
                               : normal.parent_path().filename().string();
}

struct Stopper {
  std::atomic<bool>& stop;
  ~Stopper() { stop = true; }
};

// Each body by itself, laid side by side.
LayeredTooth voxelize_bodies(const ImageVolume<std::uint16_t>& labels, const ScanJob& job,
                             VoxelizeReport& report) {
  std::vector<LayeredTooth> teeth;
  std::vector<Body> list;
  VoxelizeOptions how = job.how;
  for (const BodyLabels& body : job.bodies) {
    std::map<std::uint16_t, Tissue> tissues;
    for (const std::uint16_t value : body.values) tissues[value] = job.tissues.at(value);
    if (job.how.progress)
      how.progress = [&](const std::string& stage, double done) {
        job.how.progress(body.body.name + ": " + stage, (static_cast<double>(list.size()) + done) /
                                                            static_cast<double>(job.bodies.size()));
      };
    VoxelizeReport own;
    teeth.push_back(voxelize_labels(labels, tissues, how, &own));
    report.notes.insert(report.notes.end(), own.notes.begin(), own.notes.end());
    list.push_back(body.body);
  }
  return combine_teeth(teeth, list);
}

VoxelizedScan voxelized(const ScanJob& job, std::unique_ptr<ScanSource> scan) {
  VoxelizedScan result;
  if (job.tissues.empty()) {
    result.tooth = voxelize_scan(*scan, job.how, &result.report);
  } else {
    const ImageVolume<std::uint16_t> labels = read_labels(*scan);
    result.tooth = job.bodies.empty()
                       ? voxelize_labels(labels, job.tissues, job.how, &result.report)
                       : voxelize_bodies(labels, job, result.report);
    const std::vector<std::string> of_scan = scan->notes();
    result.report.notes.insert(result.report.notes.begin(), of_scan.begin(), of_scan.end());
  }
  return result;
}

}  // namespace

VoxelizedScan voxelize_file(const ScanJob& job) {
  ScanReadOptions reading = job.reading;
  reading.labels = !job.tissues.empty();
  try {
    std::unique_ptr<ScanSource> scan = open_scan(job.path, reading);
    // Beside the work: it takes about as long as reading. A refusal does not wait for it.
    std::atomic<bool> stop = false;
    std::future<std::string> hash = std::async(
        std::launch::async, [&] { return sha256_of_scan(job.path, job.reading.series, &stop); });
    const Stopper stopper{stop};
    const bool placeholder = !reading.spacing_mm && scan->frame().spacing == Vec3::Ones();
    if (job.roi) scan = crop(std::move(scan), *job.roi);
    VoxelizedScan result = voxelized(job, std::move(scan));
    if (placeholder)
      result.report.notes.insert(
          result.report.notes.begin(),
          "a spacing of 1 x 1 x 1 mm looks like a placeholder; give the true voxel size with "
          "--spacing-mm");
    result.tooth.provenance["source"] = name_of(job.path);
    result.tooth.provenance["source_sha256"] = hash.get();
    return result;
  } catch (const InputError&) {
    throw;
  } catch (const Error& e) {  // says what; the file is known here
    throw InputError(job.path, "", e.what());
  }
}

}  // namespace toothprep
