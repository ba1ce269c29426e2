#include "toothprep/tools/render/image.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "toothprep/step/core/errors.h"

namespace toothprep {

Image empty_image(const Camera& camera) {
  Image image;
  image.camera = camera;
  const auto pixels =
      static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  image.rgba.assign(4 * pixels, 0);
  image.depth.assign(pixels, std::numeric_limits<float>::infinity());
  image.normal.assign(3 * pixels, 0);
  image.tissue.assign(pixels, 0);
  image.deviation.assign(pixels, std::numeric_limits<float>::quiet_NaN());
  return image;
}

namespace {

// Leaves what is darker than the knee alone and never reaches 1.
float shoulder(float v) {
  constexpr float kKnee = 0.8f;
  return v <= kKnee ? v : kKnee + (1 - kKnee) * std::tanh((v - kKnee) / (1 - kKnee));
}

}  // namespace

Picture picture_of(const Image& image, const Colour& background) {
  Picture picture{image.width(), image.height(), {}};
  const std::size_t pixels = image.depth.size();
  picture.rgb.resize(3 * pixels);
  for (std::size_t p = 0; p < pixels; ++p) {
    const float alpha = image.rgba[4 * p + 3];
    for (int k = 0; k < 3; ++k) {
      const float own = alpha > 0 ? alpha * shoulder(image.rgba[4 * p + k] / alpha) : 0;
      const float s = srgb_from_linear(own + (1 - alpha) * background[k]);
      picture.rgb[3 * p + k] = static_cast<std::uint8_t>(255 * s + 0.5f);
    }
  }
  return picture;
}

Picture side_by_side(const std::vector<Picture>& pictures) {
  Picture row;
  for (const Picture& p : pictures) {
    if (row.height != 0 && p.height != row.height)
      throw Error("pictures of unequal height can't stand side by side");
    row.height = p.height;
    row.width += p.width;
  }
  row.rgb.reserve(3 * static_cast<std::size_t>(row.width) * static_cast<std::size_t>(row.height));
  for (int y = 0; y < row.height; ++y)
    for (const Picture& p : pictures) {
      const auto line = p.rgb.begin() + static_cast<std::ptrdiff_t>(3) * p.width * y;
      row.rgb.insert(row.rgb.end(), line, line + static_cast<std::ptrdiff_t>(3) * p.width);
    }
  return row;
}

}  // namespace toothprep
