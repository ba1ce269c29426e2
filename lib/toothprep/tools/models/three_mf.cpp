// 3MF (3MF Consortium, "3D Manufacturing Format, Core Specification", 1.3): an OPC package, which is a
// ZIP of XML.
#include <archive.h>
#include <archive_entry.h>

#include <array>
#include <cmath>
#include <cstddef>
#include <exception>
#include <memory>
#include <string>
#include <string_view>
#include <utility>

#include "toothprep/step/core/number_text.h"
#include "toothprep/tools/models/formats.h"
#include "toothprep/tools/models/tissue_triangles.h"
#include "toothprep/tools/render/colours.h"

namespace toothprep {
namespace {

constexpr std::string_view kXml = R"(<?xml version="1.0" encoding="UTF-8"?>)"
                                  "\n";
constexpr std::string_view kContentTypes =
    R"(<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">)"
    R"(<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>)"
    R"(<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>)"
    "</Types>\n";
constexpr std::string_view kRelationships =
    R"(<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">)"
    R"(<Relationship Id="model" Target="/3D/3dmodel.model" )"
    R"(Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>)"
    "</Relationships>\n";

std::string hexadecimal(const Colour& colour) {
  constexpr std::string_view kDigits = "0123456789ABCDEF";
  std::string text = "#";
  for (int k = 0; k < 3; ++k) {
    const auto level = static_cast<std::size_t>(std::lround(255 * srgb_from_linear(colour[k])));
    text += {kDigits[level / 16], kDigits[level % 16]};
  }
  return text;
}

template <class Number>
void add_attribute(std::string& xml, std::string_view name, Number value) {
  xml += ' ';
  xml += name;
  xml += "=\"";
  xml += shortest_text(value);
  xml += '"';
}

std::string model_of(const TriangleMesh& mesh) {
  std::string xml(kXml);
  xml.reserve(48 * mesh.vertices.size() + 64 * mesh.triangles.size() + 1024);
  xml +=
      R"(<model unit="millimeter" xml:lang="en" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">)"
      "\n<metadata name=\"Title\">tooth</metadata>\n"
      "<metadata name=\"Application\">toothprep</metadata>\n<resources>\n<basematerials id=\"1\">";
  std::array<int, kTissueCount + 1> material{};
  int materials = 0;
  for (const TissueTriangles& part : triangles_by_tissue(mesh)) {
    material[static_cast<std::size_t>(part.tissue)] = materials++;
    xml += "<base name=\"" + std::string(material_name(part.tissue)) + "\" displaycolor=\"" +
           hexadecimal(tissue_colour(part.tissue)) + "\"/>";
  }
  xml +=
      "</basematerials>\n<object id=\"2\" type=\"model\" name=\"tooth\" pid=\"1\" pindex=\"0\">"
      "<mesh>\n<vertices>\n";
  for (const auto& v : mesh.vertices) {
    xml += "<vertex";
    add_attribute(xml, "x", v.x());
    add_attribute(xml, "y", v.y());
    add_attribute(xml, "z", v.z());
    xml += "/>\n";
  }
  xml += "</vertices>\n<triangles>\n";
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    xml += "<triangle";
    add_attribute(xml, "v1", mesh.triangles[t][0]);
    add_attribute(xml, "v2", mesh.triangles[t][1]);
    add_attribute(xml, "v3", mesh.triangles[t][2]);
    xml += " pid=\"1\"";
    add_attribute(xml, "p1", material[static_cast<std::size_t>(tissue_of(mesh, t))]);
    xml += "/>\n";
  }
  return xml +
         "</triangles>\n</mesh></object>\n</resources>\n<build><item objectid=\"2\"/></build>\n"
         "</model>\n";
}

// A ZIP in memory. Its entries have no time: programs show the format's first day, 1980-01-01.
class Zip {
 public:
  Zip() : archive_(archive_write_new(), &archive_write_free) {
    if (!archive_) throw Error("no memory for a ZIP");
    check(archive_write_set_format_zip(archive_.get()));
    check(archive_write_set_options(archive_.get(), "zip:compression=deflate"));
    check(archive_write_set_bytes_in_last_block(archive_.get(), 1));  // no padding
    check(archive_write_open2(archive_.get(), this, nullptr, &Zip::append, nullptr, nullptr));
  }
  Zip(const Zip&) = delete;
  Zip& operator=(const Zip&) = delete;

  void add(const char* name, std::string_view content) {
    const std::unique_ptr<archive_entry, decltype(&archive_entry_free)> entry(archive_entry_new(),
                                                                              &archive_entry_free);
    if (!entry) throw Error("no memory for a ZIP");
    archive_entry_set_pathname(entry.get(), name);
    archive_entry_set_filetype(entry.get(), AE_IFREG);
    archive_entry_set_perm(entry.get(), 0644);
    archive_entry_set_size(entry.get(), static_cast<la_int64_t>(content.size()));
    check(archive_write_header(archive_.get(), entry.get()));
    if (archive_write_data(archive_.get(), content.data(), content.size()) !=
        static_cast<la_ssize_t>(content.size()))
      check(ARCHIVE_FATAL);
  }
  std::string finish() {
    check(archive_write_close(archive_.get()));
    return std::move(bytes_);
  }

 private:
  void check(int result) {
    if (result == ARCHIVE_OK) return;
    const char* reason = archive_error_string(archive_.get());
    throw Error(std::string("the ZIP can't be made: ") + (reason ? reason : "no reason given"));
  }
  static la_ssize_t append(archive*, void* zip, const void* data, std::size_t size) {
    try {
      static_cast<Zip*>(zip)->bytes_.append(static_cast<const char*>(data), size);
    } catch (const std::exception&) {
      return -1;
    }
    return static_cast<la_ssize_t>(size);
  }

  std::string bytes_;
  std::unique_ptr<archive, decltype(&archive_write_free)> archive_;
};

}  // namespace

std::string three_mf_of(const TriangleMesh& mesh) {
  Zip zip;
  zip.add("[Content_Types].xml", std::string(kXml).append(kContentTypes));
  zip.add("_rels/.rels", std::string(kXml).append(kRelationships));
  zip.add("3D/3dmodel.model", model_of(mesh));
  return zip.finish();
}

}  // namespace toothprep
