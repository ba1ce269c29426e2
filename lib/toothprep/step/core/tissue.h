// The tissues of a layered tooth and their labels, as they stand in the `tissue` grid of a tooth
// file.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

namespace toothprep {
// A voxel's label.
enum class Tissue : std::uint8_t { kAir = 0, kEnamel = 1, kDentin = 2, kPulp = 3, kOther = 4 };

// Solid tissues, in the order of every array "per tissue" (index = label - 1).
constexpr int kTissueCount = 4;
constexpr std::array<std::string_view, kTissueCount> kTissueNames = {"enamel", "dentin", "pulp",
                                                                     "other"};  // in that order
template <class T>
using PerTissue = std::array<T, kTissueCount>;  // in that order

constexpr int tissue_index(Tissue t) { return static_cast<int>(t) - 1; }          // -1 for air
constexpr Tissue tissue_at(int index) { return static_cast<Tissue>(index + 1); }  // of a solid one

// The tissue of that name ("enamel", ...), or nothing.
[[nodiscard]] constexpr std::optional<Tissue> tissue_named(std::string_view name) {
  for (int k = 0; k < kTissueCount; ++k)
    if (kTissueNames[k] == name) return tissue_at(k);
  return std::nullopt;
}

}  // namespace toothprep
