// A drawn picture and what is known at each of its pixels; row 0 is at the top.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "toothprep/tools/render/colours.h"
#include "toothprep/tools/render/view.h"

namespace toothprep {

struct Image {    // what the renderer gives: colour and data, row by row
  Camera camera;  // with its width and height
  // Averaged over the pixel: red, green, blue (linear, times alpha) and alpha (covered share).
  std::vector<float> rgba;
  // At the pixel's centre, not averaged:
  std::vector<float> depth;      // mm from the camera's plane; +infinity in the background
  std::vector<float> normal;     // x, y, z of the unit normal in W, to the camera's side; else 0
  std::vector<float> tissue;     // a Tissue label; 0 in the background and where it isn't known
  std::vector<float> deviation;  // mm; NaN in the background and where it isn't known

  int width() const { return camera.width; }             // pixels
  int height() const { return camera.height; }           // pixels
  [[nodiscard]] std::size_t pixel(int x, int y) const {  // place in the arrays (rgba: times 4)
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(camera.width) +
           static_cast<std::size_t>(x);
  }
};

[[nodiscard]] Image empty_image(const Camera& camera);  // background everywhere

// Multi-channel OpenEXR with the channels R, G, B, A (half), Z, N.X, N.Y, N.Z, tissue.ID,
// deviation.Y (float), ZIP. The same picture gives the same bytes. Attributes: toothprep:view
// (text), toothprep:mmPerPixel, toothprep:origin, toothprep:right, toothprep:up, toothprep:forward
// (the camera's, in W), and those of `notes`. Throws Error if it can't be written.
void write_exr(const Image& image, const std::string& path,
               const std::map<std::string, std::string>& notes = {});

// Finished 8-bit pixels: red, green, blue.
struct Picture {
  int width = 0, height = 0;      // pixels
  std::vector<std::uint8_t> rgb;  // row by row from the top
};

// sRGB over a background (linear); highlights run softly into white.
Picture picture_of(const Image& image, const Colour& background = {0.58f, 0.62f, 0.66f});

// Of one height, left to right.
[[nodiscard]] Picture side_by_side(const std::vector<Picture>& pictures);

[[nodiscard]] std::string png_bytes(const Picture& picture);      // a whole file
void write_png(const Picture& picture, const std::string& path);  // throws Error

}  // namespace toothprep
