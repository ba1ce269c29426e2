#include "toothprep/step/bur/bur_library.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <utility>

#include "toothprep/step/bur/bur_shapes.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/nearest_name.h"
#include "toothprep/step/core/strict_toml.h"

namespace toothprep {
namespace {

std::string lower(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

struct RZ {
  double r, z;
};

std::optional<RZ> pair(StrictTable& table, const std::string& key) {
  const auto values = table.numbers(key);
  if (!values) return {};
  if (values->size() != 2)
    table.refuse(key, "must be two numbers [r, z], found " + std::to_string(values->size()));
  return RZ{(*values)[0], (*values)[1]};
}

// The centre of the arc below 180 degrees between two points, on the solid's side if convex.
RZ centre_of(StrictTable& table, RZ from, RZ to, double radius, bool convex) {
  const double cr = to.r - from.r, cz = to.z - from.z, chord = std::hypot(cr, cz);
  if (!(radius >= 0.5 * chord))
    table.refuse("radius_mm", "is smaller than half the distance between the arc's ends");
  const double high = std::sqrt(std::max(0.0, radius * radius - 0.25 * chord * chord));
  const double side = (convex ? 1 : -1) * high / chord;  // the solid lies to the left
  return {0.5 * (from.r + to.r) - side * cz, 0.5 * (from.z + to.z) + side * cr};
}

std::vector<ProfilePiece> read_pieces(std::vector<StrictTable>& tables) {
  std::vector<ProfilePiece> pieces;
  RZ at = {0, 0};
  for (StrictTable& table : tables) {
    const auto kind = table.choice("kind", {"line", "arc", "polyline"});
    if (!kind) table.missing("kind", "\"line\"");
    const bool grinds = table.boolean("grinds").value_or(true);
    if (*kind == "polyline") {
      const auto r = table.numbers("r_mm"), z = table.numbers("z_mm");
      if (!r) table.missing("r_mm", "[0.6, 0.6]");
      if (!z) table.missing("z_mm", "[0.0, 3.0]");
      if (r->size() != z->size() || r->empty())
        table.refuse("z_mm", "must have as many numbers as r_mm, at least one");
      for (std::size_t i = 0; i < r->size(); ++i) {
        const RZ to = {(*r)[i], (*z)[i]};
        // A measured outline may repeat the point that it starts from.
        if (std::hypot(to.r - at.r, to.z - at.z) > 1e-6)
          pieces.push_back(line_piece(at.r, at.z, to.r, to.z, grinds));
        at = to;
      }
    } else {
      const auto to = pair(table, "to_mm");
      if (!to) table.missing("to_mm", "[0.6, 0.0]");
      if (*kind == "line") {
        pieces.push_back(line_piece(at.r, at.z, to->r, to->z, grinds));
      } else {
        const bool convex = table.boolean("convex").value_or(true);
        const auto centre = pair(table, "center_mm");
        const auto radius = table.number("radius_mm");
        if (centre.has_value() == radius.has_value())
          table.refuse("center_mm", "an arc needs either center_mm or radius_mm");
        const RZ c = centre ? *centre : centre_of(table, at, *to, *radius, convex);
        pieces.push_back(arc_piece(at.r, at.z, to->r, to->z, c.r, c.z, convex, grinds));
      }
      at = *to;
    }
    table.done();
  }
  double top = 0;
  for (const ProfilePiece& piece : pieces) top = std::max({top, piece.z0, piece.z1});
  if (at.r > 1e-6 && at.z >= top && top > 0)
    pieces.push_back(line_piece(at.r, at.z, 0, at.z, false));
  return pieces;
}

std::vector<ProfilePiece> outline_of_shape(const std::string& path, const std::string& shape) {
  try {
    return bur_from_shorthand(shape).profile();
  } catch (const Error& error) {
    throw InputError(path, "shape", error.what());
  }
}

// Reads the library's text once and hands back its entries.
std::vector<LibraryEntry> read_library(const std::string& path) {
  const toml::table root = parse_toml(read_small_text(path), path);
  StrictTable table(root, path);
  const auto sources = table.table("sources");
  const toml::table* source_texts = sources ? root["sources"].as_table() : nullptr;
  auto burs = table.tables("bur");
  if (!burs || burs->empty()) throw InputError(path, "bur", "lists no bur");
  table.done();

  std::vector<LibraryEntry> entries;
  for (StrictTable& bur : *burs) {
    const auto name = bur.text("name"), shape = bur.text("shape"),
               description = bur.text("description");
    if (!name) bur.missing("name", "\"837-012\"");
    if (!shape) bur.missing("shape", "\"cylinder:D1.2xL8.0\"");
    if (!description) bur.missing("description", "\"flat-end cylinder\"");
    LibraryEntry entry = {*name, bur.text("also").value_or(""), *shape, *description, ""};
    auto source = bur.table("source");
    if (!source) bur.missing("source", "{ D = \"where the diameter comes from\" }");
    for (const char* letter : {"D", "L", "T", "A", "R", "N", "B", "S"}) {
      auto text = source->text(letter);
      if (!text) continue;
      if (source_texts)
        if (const auto full = (*source_texts)[*text].value<std::string>()) text = full;
      entry.source += (entry.source.empty() ? "" : "; ") + std::string(letter) + ": " + *text;
    }
    source->done();
    bur.done();
    entries.push_back(std::move(entry));
  }
  return entries;
}

[[noreturn]] void refuse_name(const std::string& spec, const std::vector<LibraryEntry>& entries) {
  std::vector<std::pair<std::size_t, std::string>> near;
  for (const LibraryEntry& entry : entries) {
    std::size_t distance = edit_distance(lower(spec.substr(0, 100)), lower(entry.name));
    if (!entry.also.empty())
      distance = std::min(distance, edit_distance(lower(spec.substr(0, 100)), lower(entry.also)));
    near.emplace_back(distance, entry.name);
  }
  std::stable_sort(near.begin(), near.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  std::string list;
  for (std::size_t i = 0; i < std::min<std::size_t>(3, near.size()); ++i)
    list += (i ? ", " : "") + near[i].second;
  throw InputError("--bur " + spec, "", "no bur of that name",
                   "the nearest are " + list +
                       "; or give a shape such as cylinder:D1.2xL3.0 or a profile file (.toml)");
}

}  // namespace

Bur make_bur(const std::string& spec, const std::string& library_folder) {
  if (spec.empty())
    throw InputError("--bur", "", "is empty", "give a shape such as cylinder:D1.2xL3.0");
  std::error_code error;
  const std::filesystem::path path(spec);
  if (path.extension() == ".toml") return read_bur_file(spec);
  for (const char* mesh : {".stl", ".ply", ".obj", ".off", ".gz"})
    if (lower(path.extension().string()) == mesh)
      throw InputError(spec, "", "is a mesh; a bur is the body that a profile sweeps when it turns",
                       "measure its diameter and length: cylinder:D1.2xL4.0 and other shapes "
                       "(--bur list), or its outline: a profile file (data/burs/README.md)");
  if (spec.find(':') != std::string::npos || is_shape(spec)) return bur_from_shorthand(spec);

  const std::vector<LibraryEntry> entries = list_library(library_folder);
  for (const LibraryEntry& entry : entries) {
    if (lower(entry.name) != lower(spec) && lower(entry.also) != lower(spec)) continue;
    const Bur bur = bur_from_shorthand(entry.shape);
    return Bur(entry.name, bur.profile(), bur.shank_radius(), bur.shank_top());
  }
  if (path.has_parent_path() || std::filesystem::is_regular_file(path, error))
    return read_bur_file(spec);
  refuse_name(spec, entries);
}

Bur read_bur_file(const std::string& path) {
  const toml::table root = parse_toml(read_small_text(path), path);
  StrictTable table(root, path);
  const std::string name = table.text("name").value_or(std::filesystem::path(path).stem().string());
  table.text("description");
  table.text("source");
  const auto shape = table.text("shape");
  auto pieces = table.tables("piece");
  auto shank = table.table("shank");
  table.done({"piece.kind", "piece.to_mm", "piece.center_mm", "piece.radius_mm", "piece.grinds",
              "piece.convex", "shank.diameter_mm", "shank.top_mm"});
  if (shape.has_value() == pieces.has_value())
    throw InputError(path, "piece", "a bur needs either a shape or [[piece]] tables");
  std::optional<double> diameter, top;
  if (shank) {
    diameter = shank->number("diameter_mm");
    top = shank->number("top_mm");
    shank->done();
  }
  try {
    std::vector<ProfilePiece> head =
        shape ? outline_of_shape(path, *shape) : checked_outline(read_pieces(*pieces));
    double length = 0;
    for (const ProfilePiece& piece : head) length = std::max(length, bounds_of(piece).z_max);
    const double neck = diameter.value_or(default_neck_diameter(head));
    const double end = top.value_or(std::min(length + kNeckLength, 50.0));
    return Bur(name, std::move(head), !diameter && !top && end <= length ? 0 : 0.5 * neck, end);
  } catch (const InputError&) {
    throw;
  } catch (const Error& error) {
    throw InputError(path, "", error.what());
  }
}

std::vector<LibraryEntry> list_library(const std::string& library_folder) {
  return read_library((std::filesystem::path(library_folder) / "library.toml").string());
}

}  // namespace toothprep
