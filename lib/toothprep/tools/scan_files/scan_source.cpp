#include "toothprep/tools/scan_files/scan_source.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <mutex>
#include <optional>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/memory_limit.h"
#include "toothprep/tools/scan_files/image_checks.h"

namespace toothprep {
namespace {

constexpr std::size_t kSlabVoxels = std::size_t{1} << 23;  // 32 MB of values
constexpr std::uint32_t kNotFinite = 0x7f800000;           // exponent of NaN and infinity

class InMemory : public ScanSource {
 public:
  InMemory(const ImageVolume<float>& volume, std::string path)
      : ScanSource(std::move(path), volume), volume_(volume) {}
  void read(int first, int count, float* values) override {
    const float* from = volume_.data.data() + volume_.offset(0, 0, first);
    std::copy_n(from, volume_.offset(0, 0, count), values);
  }

 private:
  const ImageVolume<float>& volume_;
};

// Throws InputError if all voxels at once, with so many bytes each, are too much.
void check_memory_for(const ScanSource& source, std::size_t bytes) {
  image::check_voxels(source.path(), source.frame().size);
  require_memory(source.path(), "size",
                 static_cast<double>(source.frame().voxels()) * static_cast<double>(bytes),
                 "read a part of it with --roi, or coarsen it");
}

struct Held {  // stands before the base that refers to it
  ImageVolume<float> volume;
};

class Owning : private Held, public InMemory {
 public:
  Owning(ImageVolume<float> held, std::string path, std::vector<std::string> notes)
      : Held{std::move(held)}, InMemory(Held::volume, std::move(path)), notes_(std::move(notes)) {}
  std::vector<std::string> notes() const override { return notes_; }

 private:
  std::vector<std::string> notes_;
};

}  // namespace

std::unique_ptr<ScanSource> source_of(const ImageVolume<float>& volume, std::string path) {
  return std::make_unique<InMemory>(volume, std::move(path));
}

std::unique_ptr<ScanSource> owning_source(ImageVolume<float> volume, std::string path,
                                          std::vector<std::string> notes) {
  return std::make_unique<Owning>(std::move(volume), std::move(path), std::move(notes));
}

void for_each_slab(ScanSource& source, int first, int last, const VisitSlab& visit,
                   const std::function<void(double)>& progress) {
  const Index3 size = source.frame().size;
  const std::size_t area = static_cast<std::size_t>(size.x()) * size.y();
  const int slices = last + 1 - first;
  const int thickness = std::clamp(static_cast<int>(kSlabVoxels / area), 1, slices);
  std::vector<float> values(area * static_cast<std::size_t>(thickness));
  for (int k = first; k <= last; k += thickness) {
    if (progress) progress(static_cast<double>(k - first) / slices);
    const int count = std::min(thickness, last + 1 - k);
    source.read(k, count, values.data());
    visit(k, count, values.data());
  }
}

void for_each_slab(ScanSource& source, const VisitSlab& visit,
                   const std::function<void(double)>& progress) {
  const Index3 size = source.frame().size;
  image::check_voxels(source.path(), size);
  const std::size_t area = static_cast<std::size_t>(size.x()) * size.y();
  std::atomic<std::size_t> bad = 0;
  for_each_slab(
      source, 0, size.z() - 1,
      [&](int first, int count, const float* values) {
        tbb::parallel_for(0, count, [&](int k) {
          const float* slice = values + static_cast<std::size_t>(k) * area;
          std::size_t found = 0;  // by the exponent's bits: this way the loop is a vector's
          for (std::size_t v = 0; v < area; ++v)
            found += (std::bit_cast<std::uint32_t>(slice[v]) & kNotFinite) == kNotFinite;
          bad += found;
        });
        visit(first, count, values);
      },
      progress);
  source.check_rest();
  if (bad > 0)
    throw InputError(source.path(), "voxel data",
                     std::to_string(bad) + " of " + std::to_string(source.frame().voxels()) +
                         " values are not finite numbers",
                     "replace them by the grey value of the surroundings");
}

ImageVolume<float> read_all(ScanSource& source) {
  ImageVolume<float> volume;
  static_cast<ImageFrame&>(volume) = source.frame();
  check_memory_for(source, sizeof(float));
  volume.data.reserve(volume.voxels());
  const std::size_t area = volume.offset(0, 0, 1);
  for_each_slab(source, [&](int, int count, const float* values) {
    volume.data.insert(volume.data.end(), values, values + area * static_cast<std::size_t>(count));
  });
  return volume;
}

ImageVolume<std::uint16_t> read_labels(ScanSource& source) {
  ImageVolume<std::uint16_t> labels;
  static_cast<ImageFrame&>(labels) = source.frame();
  check_memory_for(source, sizeof(std::uint16_t));
  labels.data.resize(labels.voxels());
  const std::size_t area = labels.offset(0, 0, 1);
  std::mutex lock;
  std::optional<float> wrong;
  for_each_slab(source, [&](int first, int count, const float* values) {
    tbb::parallel_for(0, count, [&](int k) {
      const float* from = values + area * static_cast<std::size_t>(k);
      std::uint16_t* to = labels.data.data() + labels.offset(0, 0, first + k);
      for (std::size_t v = 0; v < area; ++v) {
        if (!std::isfinite(from[v])) continue;  // said when all were read
        const auto label = static_cast<std::uint16_t>(std::clamp(from[v], 0.0f, 65535.0f));
        if (static_cast<float>(label) != from[v]) {
          const std::scoped_lock guard(lock);
          if (!wrong) wrong = from[v];
          return;
        }
        to[v] = label;
      }
    });
  });
  if (wrong)
    throw InputError(source.path(), "voxel data",
                     "holds the value " + image::number(*wrong) + ", which is no label",
                     "labels are integers in 0..65535; a grey scan goes without --labels");
  return labels;
}

}  // namespace toothprep
