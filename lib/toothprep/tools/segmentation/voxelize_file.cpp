#include "toothprep/tools/segmentation/voxelize_file.h"

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <functional>
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

// Of the n-th of so many bodies.
std::function<void(const std::string&, double)> progress_of(const ScanJob& job, const Body& body,
                                                            std::size_t n, std::size_t count) {
  if (!job.how.progress) return {};
  return [&job, name = body.name, n, count](const std::string& stage, double done) {
    job.how.progress(name + ": " + stage,
                     (static_cast<double>(n) + done) / static_cast<double>(count));
  };
}

// Each body by itself, laid side by side.
LayeredTooth voxelize_bodies(const ImageVolume<std::uint16_t>& labels, const ScanJob& job,
                             VoxelizeReport& report) {
  std::vector<LayeredTooth> teeth;
  std::vector<Body> list;
  VoxelizeOptions how = job.how;
  for (const BodyLabels& body : job.bodies) {
    std::map<std::uint16_t, Tissue> tissues;
    for (const std::uint16_t value : body.values) tissues[value] = job.tissues.at(value);
    how.progress = progress_of(job, body.body, list.size(), job.bodies.size());
    VoxelizeReport own;
    teeth.push_back(voxelize_labels(labels, tissues, how, &own));
    report.notes.insert(report.notes.end(), own.notes.begin(), own.notes.end());
    list.push_back(body.body);
  }
  return combine_teeth(teeth, list);
}

// The tooth that is prepared and its neighbours, each made by itself. `make` is called with options and
// a report.
template <class Make>
LayeredTooth with_neighbours(const ScanJob& job, const Make& make, VoxelizeReport& report) {
  if (job.neighbours.empty()) return make(job.how, report);
  std::vector<LayeredTooth> teeth;
  std::vector<Body> list;
  VoxelizeOptions how = job.how;
  const auto add = [&](const Body& body, VoxelizeReport& own) {
    how.progress = progress_of(job, body, list.size(), job.neighbours.size() + 1);
    teeth.push_back(make(how, own));
    list.push_back(body);
  };
  add({"tooth", BodyKind::kTooth}, report);
  how.keep_greys = false;
  for (const NeighbourChoice& neighbour : job.neighbours) {
    how.tooth = neighbour.tooth;
    how.tooth_at = neighbour.tooth_at;
    VoxelizeReport own;
    add(neighbour.body, own);
    for (const std::string& note : own.notes)
      if (std::find(report.notes.begin(), report.notes.end(), note) == report.notes.end())
        report.notes.push_back(neighbour.body.name + ": " + note);
  }
  return combine_teeth(teeth, list);
}

VoxelizedScan voxelized(const ScanJob& job, std::unique_ptr<ScanSource> scan) {
  VoxelizedScan result;
  if (job.tissues.empty()) {
    const auto make = [&](const VoxelizeOptions& how, VoxelizeReport& report) {
      return voxelize_scan(*scan, how, &report);
    };
    result.tooth = with_neighbours(job, make, result.report);
  } else {
    const ImageVolume<std::uint16_t> labels = read_labels(*scan);
    const auto make = [&](const VoxelizeOptions& how, VoxelizeReport& report) {
      return voxelize_labels(labels, job.tissues, how, &report);
    };
    result.tooth = job.bodies.empty() ? with_neighbours(job, make, result.report)
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
