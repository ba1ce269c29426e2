#include "toothprep/tools/io/memory_limit.h"

#include <fmt/format.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <optional>
#include <sstream>

#include "toothprep/step/core/errors.h"

namespace toothprep {
namespace fs = std::filesystem;
namespace {

constexpr std::uint64_t kNoLimit = std::numeric_limits<std::uint64_t>::max();

std::optional<std::uint64_t> number_in(const fs::path& file) {
  std::uint64_t value = 0;  // "max" is none
  if (!(std::ifstream(file) >> value)) return {};
  return value;
}

// The line "KEY VALUE" or "KEY: VALUE kB" of a file of such lines, as it stands.
std::optional<std::uint64_t> field_in(const fs::path& file, const std::string& key) {
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    std::istringstream words(line);
    std::string name;
    std::uint64_t value = 0;
    if (words >> name >> value && (name == key || name == key + ":")) return value;
  }
  return {};
}

// What the group of this folder leaves. Its page cache counts as used but is given back on demand.
std::uint64_t left_in_group(const fs::path& folder, bool version2) {
  const auto limit = number_in(folder / (version2 ? "memory.max" : "memory.limit_in_bytes"));
  const auto used = number_in(folder / (version2 ? "memory.current" : "memory.usage_in_bytes"));
  if (!limit || !used) return kNoLimit;
  const std::uint64_t cache =
      field_in(folder / "memory.stat", version2 ? "inactive_file" : "total_inactive_file")
          .value_or(0);
  return *limit - std::min(*limit, *used - std::min(*used, cache));
}

std::uint64_t left_in_groups() {
  std::uint64_t left = kNoLimit;
  std::ifstream in("/proc/self/cgroup");  // lines "ID:CONTROLLERS:/PATH"; version 2 names none
  for (std::string line; std::getline(in, line);) {
    const auto first = line.find(':'), second = line.find(':', first + 1);
    if (second == std::string::npos) continue;
    const std::string controllers = line.substr(first + 1, second - first - 1);
    const bool version2 = controllers.empty();
    if (!version2 && controllers != "memory") continue;
    const fs::path root(version2 ? "/sys/fs/cgroup" : "/sys/fs/cgroup/memory");
    // In a container the path may be the host's: then the root alone is there.
    for (fs::path group = line.substr(second + 1);; group = group.parent_path()) {
      left = std::min(left, left_in_group(root / group.relative_path(), version2));
      if (!group.has_relative_path()) break;
    }
  }
  return left;
}

std::uint64_t left_of_address_space() {
  rlimit limit{};
  if (getrlimit(RLIMIT_AS, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY) return kNoLimit;
  const std::uint64_t used =
      number_in("/proc/self/statm").value_or(0) * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
  return limit.rlim_cur - std::min<std::uint64_t>(limit.rlim_cur, used);
}

}  // namespace

std::uint64_t available_memory() {
  const auto free = field_in("/proc/meminfo", "MemAvailable");  // kB
  return std::min({free ? *free * 1024 : kNoLimit, left_in_groups(), left_of_address_space()});
}

void require_memory(const std::string& file, const std::string& place, double bytes,
                    const std::string& remedy) {
  const auto available = static_cast<double>(available_memory());
  if (bytes > available)
    throw InputError(
        file, place,
        "needs " + size_text(bytes) + " of memory, " + size_text(available) + " are available",
        remedy);
}

std::string announced_voxels(double voxels, double voxel_mm, double bytes_per_voxel,
                             double seconds_per_voxel) {
  constexpr double kMostVoxels = 0x1p29, kLittleBytes = 1e9, kLittleTime = 30;  // bytes, s
  const double bytes = voxels * bytes_per_voxel, seconds = voxels * seconds_per_voxel;
  const auto available = static_cast<double>(available_memory());
  const std::string what =
      fmt::format("{:.3g} million voxels of {:.3g} mm", voxels / 1e6, voxel_mm);
  const double factor = std::max(voxels / kMostVoxels, bytes / available);
  if (factor > 1) {
    // A tenth more than it takes, in two digits.
    const double fits = 1.1 * voxel_mm * std::cbrt(factor);
    const double digit = std::pow(10.0, std::floor(std::log10(fits)) - 1);
    const std::string why = voxels > kMostVoxels
                                ? "are more than 2^29"
                                : fmt::format("take about {} of memory, {} are available",
                                              size_text(bytes), size_text(available));
    throw Error(fmt::format("{} {}; --voxel-mm {:.3g} would fit", what, why,
                            std::ceil(fits / digit) * digit));
  }
  if (bytes < kLittleBytes && seconds < kLittleTime) return {};
  return fmt::format("{}: about {} of memory and {:.0f} s", what, size_text(bytes), seconds);
}

std::string size_text(double bytes) {
  const bool giga = bytes >= 0.9995e9;
  const double value = bytes / (giga ? 1e9 : 1e6);
  return fmt::format("{:.{}f} {}", value, value < 9.95 ? 1 : 0, giga ? "GB" : "MB");
}

}  // namespace toothprep
