#include "toothprep/tools/segmentation/plausibility.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cstring>

namespace toothprep {

Layers layers_of(const WorkBox& box, const ToothFields& fields) {
  const std::vector<std::uint8_t>& label = fields.label;
  const std::array<std::size_t, 3> stride = {1, box.offset(0, 1, 0), box.offset(0, 0, 1)};
  std::vector<Layers> by_plane(static_cast<std::size_t>(box.size.z()));
  tbb::parallel_for(0, box.size.z(), [&](int k) {
    Layers& plane = by_plane[static_cast<std::size_t>(k)];
    const std::size_t first = box.offset(0, 0, k), last = first + stride[2];
    const auto count = [&](Tissue t) {
      return static_cast<double>(
          std::count(label.data() + first, label.data() + last, static_cast<std::uint8_t>(t)));
    };
    plane.enamel = count(Tissue::kEnamel);
    plane.dentin = count(Tissue::kDentin);
    plane.pulp = count(Tissue::kPulp);
    for (int j = 0; j < box.size.y(); ++j)
      for (std::size_t a = 0; a < 3; ++a) {
        if ((a == 1 && j + 1 == box.size.y()) || (a == 2 && k + 1 == box.size.z())) continue;
        const std::size_t row = box.offset(0, j, k), end = row + stride[1] - (a == 0);
        constexpr std::size_t kAtOnce = 16;
        for (std::size_t v = row; v < end; ++v) {
          // Most have neighbours of their own label.
          while (v + kAtOnce <= end && std::memcmp(&label[v], &label[v + stride[a]], kAtOnce) == 0)
            v += kAtOnce;
          if (v == end) break;
          if (label[v] == label[v + stride[a]]) continue;
          const auto here = static_cast<Tissue>(label[v]),
                     next = static_cast<Tissue>(label[v + stride[a]]);
          const auto between = [&](Tissue x, Tissue y) {
            return (here == x && next == y) || (here == y && next == x);
          };
          plane.enamel_air += between(Tissue::kEnamel, Tissue::kAir);
          plane.enamel_dentin += between(Tissue::kEnamel, Tissue::kDentin);
          plane.dentin_air += between(Tissue::kDentin, Tissue::kAir);
        }
      }
  });
  Layers all;
  for (const Layers& plane : by_plane) {
    all.enamel += plane.enamel;
    all.dentin += plane.dentin;
    all.pulp += plane.pulp;
    all.enamel_air += plane.enamel_air;
    all.enamel_dentin += plane.enamel_dentin;
    all.dentin_air += plane.dentin_air;
  }
  return all;
}

namespace {

// Of the molar specimen and two scanned teeth, whole or cut at any height that leaves dentin:
// 0.57 to 2.6, 0.62 to 0.68, 0.29 to 0.75, 1.14 to 1.9. Of stumps without enamel, whose pulp
// counts as dentin: 0.06 to 0.07, 0.8 to 0.87, 1.0, 1.4 to 15.
constexpr double kLeastDentin = 0.25;                       // of the enamel's volume
constexpr double kLeastOutside = 0.3;                       // of the enamel's faces
constexpr double kMostCovered = 0.95, kLittleDentin = 0.5;  // of the dentin's faces; of the enamel
constexpr double kLeastRatio = 1.08, kMostRatio = 3;

std::string why_implausible(const Layers& layers, const GreyClasses& classes) {
  const auto percent = [](double share) { return short_number(100 * share) + " %"; };
  const double dentin = layers.dentin / layers.enamel;
  if (!(dentin >= kLeastDentin))
    return "there would be " + percent(dentin) + " as much dentin as enamel";
  const double outside = layers.enamel_air / (layers.enamel_air + layers.enamel_dentin);
  if (!(outside >= kLeastOutside))
    return "only " + percent(outside) + " of the enamel's surface would face the outside";
  const double covered = layers.enamel_dentin / (layers.enamel_dentin + layers.dentin_air);
  if (dentin < kLittleDentin && covered > kMostCovered && !(layers.pulp > 0))
    return "the dentin would lie inside the enamel all around, without pulp";
  const double ratio =
      (classes.enamel - classes.surroundings) / (classes.dentin - classes.surroundings);
  if (!(ratio >= kLeastRatio && ratio <= kMostRatio))
    return "enamel's grey would be " + short_number(ratio) +
           " times as far from the surroundings' as dentin's (1.2 to 2 in teeth)";
  return {};
}

}  // namespace

std::string implausible_layers(const Layers& layers, const GreyClasses& classes) {
  if (!(layers.enamel > 0)) return {};  // by thresholds that are typical of dentin alone
  const std::string why = why_implausible(layers, classes);
  if (why.empty()) return {};
  const double contrast = classes.enamel - classes.surroundings;
  return "the grey values " + short_number(classes.dentin) + " and " +
         short_number(classes.enamel) + " can't be a tooth's dentin and enamel: " + why +
         "; give --thresholds DENTIN,ENAMEL (of a tooth without enamel, a stump or a root: "
         "--thresholds " +
         short_number(classes.surroundings + 0.5 * contrast) + "," +
         short_number(classes.enamel + 0.5 * contrast) + ")";
}

}  // namespace toothprep
