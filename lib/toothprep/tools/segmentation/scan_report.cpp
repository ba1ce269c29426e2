#include "toothprep/tools/segmentation/scan_report.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <vector>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/csv_writer.h"
#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/io/write_file.h"
#include "toothprep/tools/segmentation/dense_filters.h"

namespace toothprep {
namespace {

constexpr int kHistogramBins = 256;
constexpr double kAround = 2.0;  // mm

struct VoxelBox {
  Index3 first, size;
};
VoxelBox voxels_of(const LayeredTooth& tooth) {
  const Box bounds = bounds_of_solid(tooth);
  const auto index = [&](const Vec3& x, double shift) {
    return Index3((tooth.lattice.to_index(x).array() + shift).floor().cast<int>());
  };
  VoxelBox box;
  box.first = index(bounds.min, -1);
  box.size = index(bounds.max, 2) - box.first + Index3::Ones();
  return box;
}

// Linear between voxel centres; NaN outside.
float grey_at(const ImageVolume<float>& scan, const Vec3& world) {
  const Vec3 at = scan.to_index() * (world - scan.origin);
  const Vec3 low = at.array().floor();
  for (int a = 0; a < 3; ++a)
    if (!(low[a] >= 0 && low[a] + 1 < scan.size[a])) return std::nanf("");
  const Index3 i = low.cast<int>();
  const Vec3 f = at - low;
  double grey = 0;
  for (int c = 0; c < 8; ++c) {
    const int x = c & 1, y = (c >> 1) & 1, z = c >> 2;
    grey += (x ? f.x() : 1 - f.x()) * (y ? f.y() : 1 - f.y()) * (z ? f.z() : 1 - f.z()) *
            scan.at(i.x() + x, i.y() + y, i.z() + z);
  }
  return static_cast<float>(grey);
}

void write_histogram(const std::string& path, const ImageVolume<float>& scan,
                     const LayeredTooth& tooth) {
  const Box box = bounds_of_solid(tooth);
  std::vector<float> greys;
  for (int k = 0; k < scan.size.z(); ++k)
    for (int j = 0; j < scan.size.y(); ++j)
      for (int i = 0; i < scan.size.x(); ++i) {
        const Vec3 x = scan.to_world(Vec3(i, j, k));
        if ((x.array() > box.min.array() - kAround).all() &&
            (x.array() < box.max.array() + kAround).all())
          greys.push_back(scan.at(i, j, k));
      }
  if (greys.empty()) greys.push_back(0);
  const auto [low, high] = std::minmax_element(greys.begin(), greys.end());
  const double first = *low,
               width = std::max((*high - *low) / static_cast<double>(kHistogramBins), 1e-12);
  std::array<double, kHistogramBins> counts{};
  for (const float g : greys)
    counts[static_cast<std::size_t>(std::clamp((g - first) / width, 0.0, kHistogramBins - 1.0))] +=
        1;
  CsvWriter out(path);
  for (const char* name : {"grey", "count"}) out.text(name);
  out.end_row();
  for (std::size_t b = 0; b < kHistogramBins; ++b) {
    out.number(first + (static_cast<double>(b) + 0.5) * width);
    out.number(counts[b]);
    out.end_row();
  }
  out.close();
}

// Of the places near a plane across an axis.
class HalfWidths {
 public:
  HalfWidths(const SurfaceUncertainty& uncertainty, double plane, int axis)
      : voxel_(uncertainty.voxel_mm) {
    for (const SurfaceUncertainty::Place& place : uncertainty.places)
      if (std::abs(centre(place.voxel)[axis] - plane) < 1.6 * voxel_)
        near_.emplace(key(place.voxel), place.half_width);
  }
  // That of the nearest place, if there is one beside the voxel in which x lies; else NaN.
  double at(const Vec3& x) const {
    double half_width = std::nan(""), least = std::numeric_limits<double>::infinity();
    if (near_.empty()) return half_width;
    const Index3 middle = (x / voxel_).array().floor().cast<int>();
    for (int n = 0; n < 27; ++n) {
      const Index3 beside = middle + Index3(n % 3, n / 3 % 3, n / 9) - Index3::Ones();
      const double square = (centre(beside) - x).squaredNorm();
      if (square >= least) continue;
      const auto found = near_.find(key(beside));
      if (found == near_.end()) continue;
      least = square;
      half_width = found->second;
    }
    return half_width;
  }

 private:
  static std::array<int, 3> key(const Index3& v) { return {v.x(), v.y(), v.z()}; }
  Vec3 centre(const Index3& v) const { return voxel_ * (v.cast<double>() + Vec3::Constant(0.5)); }
  double voxel_;
  std::map<std::array<int, 3>, float> near_;
};

// Whether a voxel has a neighbour of another tissue.
bool on_surface(const LayeredTooth& tooth, const Index3& at) {
  const auto tissue = [&](const Index3& v) { return tooth.tissue.value(v.x(), v.y(), v.z()); };
  for (int a = 0; a < 3; ++a)
    for (const int side : {-1, 1})
      if (tissue(at + side * Index3::Unit(a)) != tissue(at)) return true;
  return false;
}

void write_slice(const std::string& path, int axis, const ImageVolume<float>* scan,
                 const LayeredTooth& tooth, const VoxelBox& box,
                 const SurfaceUncertainty& uncertainty) {
  const int u = axis == 0 ? 1 : 0, v = axis == 2 ? 1 : 2;
  CsvWriter out(path);
  for (const char* name : {"u_mm", "v_mm", "grey", "tissue", "half_width_mm"}) out.text(name);
  out.end_row();
  Index3 at = box.first + box.size / 2;
  const HalfWidths half_widths(uncertainty, tooth.lattice.to_world(at)[axis], axis);
  for (at[v] = box.first[v]; at[v] < box.first[v] + box.size[v]; ++at[v])
    for (at[u] = box.first[u]; at[u] < box.first[u] + box.size[u]; ++at[u]) {
      const Vec3 x = tooth.lattice.to_world(at);
      out.number(x[u]);
      out.number(x[v]);
      out.number(scan ? grey_at(*scan, x) : std::nan(""));
      out.number(tooth.tissue.value(at.x(), at.y(), at.z()));
      out.number(on_surface(tooth, at) ? half_widths.at(x) : std::nan(""));
      out.end_row();
    }
  out.close();
}

// Distance from a voxel's centre to the surface of what lies under the enamel, mm. The distance map
// says about where the nearest of its voxels lies; the level sets there say where the surface is.
double distance_beneath(const LayeredTooth& tooth, const VoxelBox& box,
                        const std::vector<float>& distance, const Index3& at) {
  const auto value = [&](const Index3& v) {
    const Index3 i = (v - box.first).cwiseMax(0).cwiseMin(box.size - Index3::Ones());
    return distance[(static_cast<std::size_t>(i.z()) * box.size.y() + i.y()) * box.size.x() +
                    i.x()];
  };
  Vec3 away;
  for (int a = 0; a < 3; ++a) away[a] = value(at + Index3::Unit(a)) - value(at - Index3::Unit(a));
  const Index3 foot = at - (away.normalized() * value(at)).array().round().matrix().cast<int>();
  double nearest = value(at);  // voxels
  bool found = false;
  for (int n = 0; n < 343; ++n) {
    const Index3 c = foot + Index3(n / 49 - 3, n / 7 % 7 - 3, n % 7 - 3);
    const std::uint8_t tissue = tooth.tissue.value(c.x(), c.y(), c.z());
    if (tissue != 2 && tissue != 3) continue;
    // Depth below the surface, which is at most the band.
    const double depth = -std::min(tooth.remains[1].value(c.x(), c.y(), c.z()),
                                   tooth.remains[2].value(c.x(), c.y(), c.z()));
    const double way = (at - c).cast<double>().norm() - depth / tooth.lattice.voxel;
    if (!found || way < nearest) nearest = way;
    found = true;
  }
  return nearest * tooth.lattice.voxel;
}

}  // namespace

EnamelThickness enamel_thickness(const LayeredTooth& tooth) {
  const VoxelBox box = voxels_of(tooth);
  const auto count = static_cast<std::size_t>(box.size.cast<double>().prod());
  const double voxel = tooth.lattice.voxel;
  const auto label = [&](std::size_t n) {
    const auto i = static_cast<int>(n % box.size.x()),
               j = static_cast<int>(n / box.size.x() % box.size.y()),
               k = static_cast<int>(n / box.size.x() / box.size.y());
    return Index3(box.first + Index3(i, j, k));
  };
  Mask beneath(count);
  bool any = false;
  for (std::size_t n = 0; n < count; ++n) {
    const Index3 at = label(n);
    const std::uint8_t tissue = tooth.tissue.value(at.x(), at.y(), at.z());
    beneath[n] = tissue == 2 || tissue == 3;
    any = any || beneath[n];
  }
  EnamelThickness result;
  if (!any) return result;
  const std::vector<float> distance = distance_to(box.size, beneath);
  std::vector<double> thickness;
  for (std::size_t n = 0; n < count; ++n) {
    const Index3 at = label(n);
    if (tooth.tissue.value(at.x(), at.y(), at.z()) != 1) continue;
    const double depth = -tooth.solid.value(at.x(), at.y(), at.z());
    if (!(depth >= 0 && depth < voxel)) continue;  // the outermost voxel
    thickness.push_back(std::max(0.0, distance_beneath(tooth, box, distance, at) + depth));
  }
  if (thickness.empty()) return result;
  std::sort(thickness.begin(), thickness.end());
  const auto percentile = [&](double p) {
    return thickness[static_cast<std::size_t>(p * static_cast<double>(thickness.size() - 1))];
  };
  double sum = 0;
  for (const double t : thickness) sum += t;
  result.points = thickness.size();
  result.mean = sum / static_cast<double>(thickness.size());
  result.median = percentile(0.5);
  result.p95 = percentile(0.95);
  result.thinnest = percentile(0.01);
  return result;
}

void write_scan_report(const std::string& folder, const LayeredTooth& tooth,
                       const VoxelizeReport& report, const std::string& version,
                       const std::string& build) {
  const ImageVolume<float>* scan = report.greys.data.empty() ? nullptr : &report.greys;
  nlohmann::ordered_json j;
  j["schema"] = "toothprep-scan-report";
  j["schema_version"] = 1;
  j["toothprep_version"] = version;
  j["build"] = build;
  j["voxel_mm"] = tooth.lattice.voxel;
  const PerTissue<double> volumes = remaining_volumes_mm3(tooth);
  for (int k = 0; k < kTissueCount; ++k) j["volume_mm3"][std::string(kTissueNames[k])] = volumes[k];
  if (scan) {
    j["threshold_dentin"] = report.threshold_dentin;
    j["threshold_enamel"] = report.threshold_enamel;
    j["grey_surroundings"] = report.surroundings;
    j["grey_dentin"] = report.dentin;
    j["grey_enamel"] = report.enamel;
    j["grey_pulp"] = report.pulp;
    if (report.blur_fwhm_mm > 0) {
      j["blur_fwhm_mm"] = report.blur_fwhm_mm;
      j["thin_enamel_mm2"] = report.thin_enamel_mm2;
    }
  }
  for (std::size_t s = 0; s < report.uncertainty.figures.size(); ++s) {
    const SurfaceUncertainty::Figures& f = report.uncertainty.figures[s];
    if (f.places > 0)
      j["half_width_mm"][kScanSurfaceNames[s]] = {
          {"rms", f.half_width}, {"median", f.median}, {"p95", f.p95}, {"places", f.places}};
  }
  const EnamelThickness t = enamel_thickness(tooth);
  if (t.points > 0)
    j["enamel_thickness_mm"] = {{"mean", t.mean},
                                {"median", t.median},
                                {"p95", t.p95},
                                {"thinnest", t.thinnest},
                                {"points", t.points}};
  j["notes"] = report.notes;
  write_file(folder + "/report.json", json_text(j));
  if (scan) write_histogram(folder + "/histogram.csv", *scan, tooth);
  const VoxelBox box = voxels_of(tooth);
  const char* names[3] = {"x", "y", "z"};
  for (int axis = 0; axis < 3; ++axis)
    write_slice(folder + "/slice-" + names[axis] + ".csv", axis, scan, tooth, box,
                report.uncertainty);
}

}  // namespace toothprep
