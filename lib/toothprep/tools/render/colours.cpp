#include "toothprep/tools/render/colours.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "toothprep/tools/mesh/diverging_colour.h"

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
  const std::array<float, 3> srgb = diverging_srgb(value);
  return {linear_from_srgb(srgb[0] / 255), linear_from_srgb(srgb[1] / 255),
          linear_from_srgb(srgb[2] / 255)};
}

}  // namespace toothprep
