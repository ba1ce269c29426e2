// toothprep mesh: the surface of a tooth file as a triangle mesh.
#include <fmt/format.h>

#include <map>
#include <memory>

#include "command.h"
#include "strictness.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/outputs.h"
#include "toothprep/tools/mesh/sharp_surface.h"
#include "toothprep/tools/models/model_file.h"

namespace toothprep::app {
namespace {

struct Options {
  std::string tooth, output;
  std::string tissue = "all";
  bool force = false, strict = false;
};

const std::map<std::string, SurfaceOf> kSurfaces = {{"all", SurfaceOf::kAll},
                                                    {"enamel", SurfaceOf::kEnamel},
                                                    {"dentin", SurfaceOf::kDentin},
                                                    {"pulp", SurfaceOf::kPulp}};

void run(const Options& o, const Common& common) {
  Outputs outputs(o.force);
  outputs.reads({o.tooth});
  const std::string output =
      outputs.file(o.output, {".ply", ".stl", ".obj", ".vtk", ".glb", ".3mf"});
  outputs.begin();
  const LayeredTooth tooth = load_tooth(o.tooth, o.strict);
  const bool sharp = tooth.parts && o.tissue == "all";
  const TriangleMesh mesh =
      sharp ? extract_sharp_surface(tooth).mesh : extract_surface(tooth, kSurfaces.at(o.tissue));
  if (mesh.triangles.empty())
    throw InputError(o.tooth, o.tissue == "all" ? "grid 'solid'" : "grid '" + o.tissue + "'",
                     "nothing remains, so there is no surface",
                     o.tissue == "all" ? "" : "choose another --tissue");
  is_model_name(output) ? write_model(mesh, output) : write_mesh(mesh, output);
  outputs.publish();
  say(common, fmt::format("{}: {} triangles around {:.4g} mm^3{}", o.output, mesh.triangles.size(),
                          mesh_volume_mm3(mesh), o.tissue == "all" ? "" : " of " + o.tissue));
}

}  // namespace

void add_mesh(CLI::App& app, const Common& common) {
  auto* sub = app.add_subcommand("mesh", "Surface of a tooth as PLY, STL, OBJ, glTF or 3MF");
  const auto o = std::make_shared<Options>();
  sub->add_option("tooth", o->tooth, "Tooth file (.vdb)")->required();
  sub->add_option(
         "-o,--output", o->output,
         "Mesh to write, in mm: .ply (with the tissue of each vertex), .stl or .obj; in the "
         "tissues' colours: .glb (glTF, in metres) or .3mf")
      ->required();
  sub->add_option("--tissue", o->tissue, "Surface of all that remains, or of one tissue")
      ->check(CLI::IsMember({"all", "enamel", "dentin", "pulp"}))
      ->capture_default_str();
  add_strict(*sub, o->strict, "a tooth that another program changed");
  sub->add_flag("--force", o->force, "Replace an existing output");
  sub->footer(
      "The surface is closed, oriented outward and free of self-intersections. Of a tooth that "
      "was\n"
      "cut here the margin, where the cut meets the tooth's own surface, is a sharp edge.\n"
      "Example: toothprep mesh prepared.vdb -o prepared.ply");
  sub->callback([o, &common] { run(*o, common); });
}

}  // namespace toothprep::app
