#include <png.h>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/write_file.h"
#include "toothprep/tools/render/image.h"

namespace toothprep {

std::string png_bytes(const Picture& picture) {
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  png.width = static_cast<png_uint_32>(picture.width);
  png.height = static_cast<png_uint_32>(picture.height);
  png.format = PNG_FORMAT_RGB;
  // Room for what doesn't compress at all; what isn't used is cut off.
  png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(png);
  std::string bytes(size, '\0');
  const bool done =
      png_image_write_to_memory(&png, bytes.data(), &size, 0, picture.rgb.data(), 0, nullptr) != 0;
  const std::string fault = png.message;
  png_image_free(&png);
  if (!done) throw Error("a picture cannot be written as PNG: " + fault);
  bytes.resize(size);
  return bytes;
}

void write_png(const Picture& picture, const std::string& path) {
  write_file(path, png_bytes(picture));
}

}  // namespace toothprep
