// toothprep mesh: the surface of a tooth file as a triangle mesh.
#include <fmt/format.h>

#include <map>
#include <memory>
#include <optional>
#include <utility>

#include "command.h"
#include "strictness.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/decimation/decimation.h"
#include "toothprep/tools/io/outputs.h"
#include "toothprep/tools/mesh/line_file.h"
#include "toothprep/tools/models/model_file.h"

namespace toothprep::app {
namespace {

struct Options {
  std::string tooth, output, lines;
  std::string tissue = "all";
  std::optional<double> max_error_mm;
  bool force = false, strict = false;
};

const std::map<std::string, SurfaceOf> kSurfaces = {{"all", SurfaceOf::kAll},
                                                    {"enamel", SurfaceOf::kEnamel},
                                                    {"dentin", SurfaceOf::kDentin},
                                                    {"pulp", SurfaceOf::kPulp}};

SharpSurface surface_of(const LayeredTooth& tooth, SurfaceOf what) {
  if (what == SurfaceOf::kAll) return surface_by_tissue(tooth);
  SharpSurface surface{extract_surface(tooth, what), {}, {}};
  surface.mesh.triangle_tissue.assign(surface.mesh.triangles.size(),
                                      static_cast<std::uint8_t>(what));
  return surface;
}

// Returns the message for the console.
std::string make_fewer(SharpSurface& surface, double max_error_mm) {
  const std::size_t before = surface.mesh.triangles.size();
  Decimation result = decimate(surface.mesh, surface.margin, max_error_mm);
  if (!result.decimated) {
    warn(
        fmt::format("--max-error-mm: no mesh of fewer triangles was found within {:.4g} mm "
                    "of this one, so it is written as it is",
                    max_error_mm));
    return "";
  }
  surface = {std::move(result.mesh), std::move(result.lines), {}};
  std::string margin;
  if (result.greatest_of_lines_mm > 0)
    margin = fmt::format(", of margins and tissue borders {:.4f} mm", result.greatest_of_lines_mm);
  return fmt::format(
      "\n  instead of {} triangles; within {:.4g} mm of them everywhere, both ways "
      "(greatest distance found {:.4f} mm{})",
      before, max_error_mm, result.greatest_mm, margin);
}

void run(const Options& o, const Common& common) {
  Outputs outputs(o.force);
  outputs.reads({o.tooth});
  const std::string output = outputs.file(o.output, kSurfaceExtensions);
  if (!o.lines.empty() && o.tissue != "all")
    throw Error("--lines are those of the whole surface; leave --tissue out");
  const std::string lines = o.lines.empty() ? "" : outputs.file(o.lines, {".obj"});
  outputs.begin();
  const LayeredTooth tooth = load_tooth(o.tooth, o.strict);
  SharpSurface surface = surface_of(tooth, kSurfaces.at(o.tissue));
  TriangleMesh& mesh = surface.mesh;
  if (mesh.triangles.empty())
    throw InputError(o.tooth, o.tissue == "all" ? "grid 'solid'" : "grid '" + o.tissue + "'",
                     "nothing remains, so there is no surface",
                     o.tissue == "all" ? "" : "choose another --tissue");
  std::string fewer;
  if (o.max_error_mm) fewer = make_fewer(surface, *o.max_error_mm);
  write_surface(mesh, output);
  if (!lines.empty()) write_lines(mesh, lines_of(surface), lines);
  outputs.publish();
  say(common,
      fmt::format("{}: {} triangles around {:.4g} mm^3{}{}", o.output, mesh.triangles.size(),
                  mesh_volume_mm3(mesh), o.tissue == "all" ? "" : " of " + o.tissue, fewer));
}

}  // namespace

void add_mesh(CLI::App& app, const Common& common) {
  auto* sub = app.add_subcommand("mesh", "Surface of a tooth as PLY, STL, OBJ, glTF or 3MF");
  const auto o = std::make_shared<Options>();
  sub->add_option("tooth", o->tooth, "Tooth file (.vdb)")->required();
  sub->add_option(
         "-o,--output", o->output,
         "Mesh to write, in mm: .ply and .vtk (with the tissue of each vertex and triangle), .stl, "
         "or "
         ".obj (a group for each tissue); in the tissues' colours: .glb (glTF, in metres) or .3mf")
      ->required();
  sub->add_option("--tissue", o->tissue, "Surface of all that remains, or of one tissue")
      ->check(CLI::IsMember({"all", "enamel", "dentin", "pulp"}))
      ->capture_default_str();
  sub->add_option("--max-error-mm", o->max_error_mm,
                  "Decimate: surface, margin and tissue borders stay within this distance of the "
                  "full mesh, in both directions")
      ->check(CLI::Range(kLeastMaxErrorMm, kGreatestMaxErrorMm));
  sub->add_option(
      "--lines", o->lines,
      "Besides, as polylines (.obj): the margin, line angles of the cut, and the borders "
      "of tissues");
  add_strict(*sub, o->strict, "a tooth that another program changed");
  sub->add_flag("--force", o->force, "Replace an existing output");
  sub->footer(
      "The surface is closed, oriented outward and free of self-intersections. Of a tooth that "
      "was\n"
      "cut here the margin, where the cut meets the tooth's own surface, is a sharp edge. Each\n"
      "triangle lies in one tissue.\n"
      "Example: toothprep mesh prepared.vdb -o prepared.ply\n"
      "         toothprep mesh prepared.vdb -o small.glb --max-error-mm 0.02");
  sub->callback([o, &common] { run(*o, common); });
}

}  // namespace toothprep::app
