#include <ImathBox.h>
#include <ImathVec.h>
#include <ImfChannelList.h>
#include <ImfFloatAttribute.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfOutputFile.h>
#include <ImfStdIO.h>
#include <ImfStringAttribute.h>
#include <ImfVecAttribute.h>
#include <half.h>

#include <algorithm>
#include <exception>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/write_file.h"
#include "toothprep/tools/render/image.h"

namespace toothprep {

void write_exr(const Image& image, const std::string& path,
               const std::map<std::string, std::string>& notes) {
  const Camera& camera = image.camera;
  const auto width = static_cast<std::size_t>(camera.width);
  std::vector<half> rgba(image.rgba.size());
  std::transform(image.rgba.begin(), image.rgba.end(), rgba.begin(),
                 [](float v) { return half(v); });
  try {
    Imf::Header header(camera.width, camera.height);
    header.compression() = Imf::ZIP_COMPRESSION;
    const auto put = [&](const char* name, const Vec3& v) {
      header.insert(
          name, Imf::V3fAttribute(Imath::V3f(static_cast<float>(v.x()), static_cast<float>(v.y()),
                                             static_cast<float>(v.z()))));
    };
    header.insert("toothprep:view", Imf::StringAttribute(camera.view));
    header.insert("toothprep:mmPerPixel",
                  Imf::FloatAttribute(static_cast<float>(camera.mm_per_pixel)));
    put("toothprep:origin", camera.origin);
    put("toothprep:right", camera.right);
    put("toothprep:up", camera.up);
    put("toothprep:forward", camera.forward);
    for (const auto& [name, text] : notes) header.insert(name, Imf::StringAttribute(text));

    Imf::FrameBuffer pixels;
    const auto channel = [&](const char* name, Imf::PixelType type, const void* data,
                             std::size_t offset, std::size_t per_pixel) {
      const std::size_t size = type == Imf::HALF ? sizeof(half) : sizeof(float);
      header.channels().insert(name, Imf::Channel(type));
      char* base = const_cast<char*>(static_cast<const char*>(data)) + offset * size;
      pixels.insert(name, Imf::Slice(type, base, per_pixel * size, per_pixel * size * width));
    };
    const char* const kColours[] = {"R", "G", "B", "A"};
    for (std::size_t k = 0; k < 4; ++k) channel(kColours[k], Imf::HALF, rgba.data(), k, 4);
    const char* const kNormal[] = {"N.X", "N.Y", "N.Z"};
    for (std::size_t k = 0; k < 3; ++k) channel(kNormal[k], Imf::FLOAT, image.normal.data(), k, 3);
    channel("Z", Imf::FLOAT, image.depth.data(), 0, 1);
    channel("tissue.ID", Imf::FLOAT, image.tissue.data(), 0, 1);
    channel("deviation.Y", Imf::FLOAT, image.deviation.data(), 0, 1);

    Imf::StdOSStream bytes;  // the file's destructor would not say that the disk is full
    {
      Imf::OutputFile file(bytes, header);
      file.setFrameBuffer(pixels);
      file.writePixels(camera.height);
    }
    write_file(path, bytes.str());
  } catch (const Error&) {
    throw;
  } catch (const std::exception& e) {
    throw Error(path + ": cannot be written as OpenEXR: " + e.what());
  }
}

}  // namespace toothprep
