#include "toothprep/tools/render/colours.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace toothprep {
namespace {

float linear_from_srgb(float s) {
  return s <= 0.04045f ? s / 12.92f : std::pow((s + 0.055f) / 1.055f, 2.4f);
}

}  // namespace

Colour colour_from_srgb(int red, int green, int blue) {
  return {linear_from_srgb(static_cast<float>(red) / 255),
          linear_from_srgb(static_cast<float>(green) / 255),
          linear_from_srgb(static_cast<float>(blue) / 255)};
}

float srgb_from_linear(float linear) {
  const float v = std::clamp(linear, 0.f, 1.f);
  return v <= 0.0031308f ? 12.92f * v : 1.055f * std::pow(v, 1 / 2.4f) - 0.055f;
}

Colour tissue_colour(Tissue tissue) {
  switch (tissue) {
    case Tissue::kEnamel:
      return {0.82f, 0.79f, 0.72f};
    case Tissue::kDentin:
      return {0.76f, 0.55f, 0.27f};
    case Tissue::kPulp:
      return {0.60f, 0.10f, 0.085f};
    case Tissue::kOther:
      return {0.36f, 0.40f, 0.45f};
    case Tissue::kAir:
      break;
  }
  return {0.66f, 0.63f, 0.58f};
}

Colour diverging_colour(float value) {
  if (std::isnan(value)) return {0.45f, 0.45f, 0.45f};
  static constexpr std::array<std::array<int, 3>, 9> kSteps = {{{33, 102, 172},
                                                                {67, 147, 195},
                                                                {146, 197, 222},
                                                                {209, 229, 240},
                                                                {247, 247, 247},
                                                                {253, 219, 199},
                                                                {244, 165, 130},
                                                                {214, 96, 77},
                                                                {178, 24, 43}}};
  const float at = 4 * (1 + std::clamp(value, -1.f, 1.f));
  const int step = std::min(static_cast<int>(at), 7);
  const float t = at - static_cast<float>(step);
  Colour mixed;  // between the classes, evenly in sRGB
  for (int k = 0; k < 3; ++k)
    mixed[k] = linear_from_srgb(((1 - t) * static_cast<float>(kSteps[step][k]) +
                                 t * static_cast<float>(kSteps[step + 1][k])) /
                                255);
  return mixed;
}

}  // namespace toothprep
