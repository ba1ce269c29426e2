#include "toothprep/tools/mesh/diverging_colour.h"

#include <algorithm>

namespace toothprep {

std::array<float, 3> diverging_srgb(float value) {
  static constexpr std::array<std::array<float, 3>, 9> kClasses = {{{33, 102, 172},
                                                                    {67, 147, 195},
                                                                    {146, 197, 222},
                                                                    {209, 229, 240},
                                                                    {247, 247, 247},
                                                                    {253, 219, 199},
                                                                    {244, 165, 130},
                                                                    {214, 96, 77},
                                                                    {178, 24, 43}}};
  const float at = 4 * (1 + std::clamp(value, -1.f, 1.f));
  const std::size_t step = std::min(static_cast<std::size_t>(at), kClasses.size() - 2);
  const float t = at - static_cast<float>(step);
  std::array<float, 3> mixed;
  for (std::size_t k = 0; k < 3; ++k)
    mixed[k] = (1 - t) * kClasses[step][k] + t * kClasses[step + 1][k];
  return mixed;
}

}  // namespace toothprep
