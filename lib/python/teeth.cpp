// Teeth: made, loaded, saved; their grids as dense copies and as views of their bricks.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>

#include "bindings.h"
#include "long_work.h"
#include "toothprep/proof/specimen/block.h"
#include "toothprep/proof/specimen/molar.h"
#include "toothprep/tools/files/tooth_file.h"
#include "toothprep/tools/io/memory_limit.h"
#include "toothprep/tools/io/outputs.h"
#include "toothprep/tools/mesh/surface.h"

namespace toothprep::python {
namespace {

const char* const kGrids[] = {"tissue", "solid", "enamel", "dentin", "pulp"};

// The same grid with the bricks in the pool in the order of the table.
template <class T>
BrickGrid<T> in_order(const BrickGrid<T>& grid, const std::vector<T>& constants) {
  BrickGrid<T> made(grid.first_brick(), grid.brick_counts(), grid.background(), constants);
  made.reserve(grid.bricks_stored());
  for (std::size_t b = 0; b < grid.table_size(); ++b)
    if (!grid.is_uniform(b))
      made.set_brick(b, grid.brick(b));
    else if (grid.uniform_value(b) != grid.background())
      made.set_uniform(b, grid.uniform_value(b));
  return made;
}

// What remains of the tissues, sharing this solid's bricks and no other's.
void store_remains_anew(LayeredTooth& tooth) {
  std::array<float, kBrickVoxels> values;
  for (const Tissue tissue : {Tissue::kDentin, Tissue::kEnamel, Tissue::kPulp}) {
    const auto k = static_cast<std::size_t>(tissue_index(tissue));
    const PackedLevelSet before = std::move(tooth.remains[k]);
    tooth.remains[k] =
        PackedLevelSet(before.first_brick(), before.brick_counts(), before.background());
    for (std::size_t b = 0; b < before.table_size(); ++b) {
      if (before.is_uniform(b) && before.uniform_value(b) == before.background()) continue;
      before.brick(b).unpack(values.data());
      set_remains(tooth, k, b, values.data());
    }
  }
}

LayeredTooth in_order(LayeredTooth tooth) {
  tooth.tissue = in_order(tooth.tissue, {1, 2, 3, 4});
  const auto inside = -static_cast<float>(tooth.band());
  tooth.solid = in_order(tooth.solid, {inside});
  tooth.solid.freeze();
  store_remains_anew(tooth);
  if (tooth.parts)
    for (LevelSet* grid : {&tooth.parts->intact, &tooth.parts->cut})
      *grid = in_order(*grid, {inside});
  return tooth;
}

Index3 first_voxel(const Tooth& t) { return t.layers.tissue.first_brick() * kBrickEdge; }

std::vector<py::ssize_t> shape_of(const Tooth& t) {
  const Index3 n = t.layers.tissue.brick_counts() * kBrickEdge;
  return {n.x(), n.y(), n.z()};
}

// visit(grid) for the grid of that name.
template <class Visit>
auto with_grid(const Tooth& t, const std::string& name, const Visit& visit) {
  if (name == "tissue") return visit(t.layers.tissue);
  if (name == "solid") return visit(t.layers.solid);
  if (const auto tissue = tissue_named(name); tissue && *tissue != Tissue::kOther)
    return visit(t.remains(static_cast<std::size_t>(tissue_index(*tissue))));
  throw py::value_error("no grid '" + name +
                        "'; a tooth has tissue, solid, enamel, dentin and pulp");
}

template <class T>
void fill_dense(const BrickGrid<T>& grid, T* out) {
  const Index3 n = grid.brick_counts() * kBrickEdge;
  const auto offset = [&](int x, int y, int z) {
    return (static_cast<std::size_t>(x) * n.y() + y) * n.z() + z;
  };
  for (std::size_t b = 0; b < grid.table_size(); ++b) {
    const Index3 at = grid.brick_origin(b) - grid.first_brick() * kBrickEdge;
    const T* values = grid.brick(b);
    for (int x = 0; x < kBrickEdge; ++x)
      for (int y = 0; y < kBrickEdge; ++y)
        std::memcpy(out + offset(at.x() + x, at.y() + y, at.z()), values + brick_offset(x, y, 0),
                    sizeof(T) * kBrickEdge);
  }
}

// toothprep.SizeError if the copy would take more than `limit` bytes.
void check_dense_size(const Tooth& t, const std::string& name, std::size_t item, double limit) {
  const std::vector<py::ssize_t> n = shape_of(t);
  const double bytes = static_cast<double>(n[0]) * static_cast<double>(n[1]) *
                       static_cast<double>(n[2]) * static_cast<double>(item);
  if (bytes <= limit) return;
  const std::string condition = fmt::format(
      "as a dense array it takes {} ({} x {} x {} voxels of {} {}), more than the {} allowed",
      size_text(bytes), n[0], n[1], n[2], item, item == 1 ? "byte" : "bytes", size_text(limit));
  const std::string remedy = "use bricks(), or give dense() another limit_bytes";
  const py::object type = py::module_::import("toothprep._errors").attr("SizeError");
  PyErr_SetObject(type.ptr(), type("grid '" + name + "': " + condition + "; " + remedy, "",
                                   "grid '" + name + "'", condition, remedy)
                                  .ptr());
  throw py::error_already_set();
}

py::array dense(const Tooth& t, const std::string& name, const std::optional<double>& limit_bytes) {
  return with_grid(t, name, [&](const auto& grid) -> py::array {
    using Value = std::decay_t<decltype(grid.background())>;
    check_dense_size(t, name, sizeof(Value),
                     limit_bytes ? *limit_bytes : static_cast<double>(available_memory()));
    py::array_t<Value> out(shape_of(t));
    Value* const data = out.mutable_data();
    const py::gil_scoped_release released;
    fill_dense(grid, data);
    return out;
  });
}

// Where whole bricks begin in the dense arrays, for those that `wanted` takes.
template <class T, class Wanted>
py::array_t<std::int32_t> brick_places(const BrickGrid<T>& grid, const Wanted& wanted) {
  std::vector<std::int32_t> places;
  for (std::size_t b = 0; b < grid.table_size(); ++b)
    if (wanted(b)) {
      const Index3 at = grid.brick_origin(b) - grid.first_brick() * kBrickEdge;
      places.insert(places.end(), {at.x(), at.y(), at.z()});
    }
  return array_from(places, {static_cast<py::ssize_t>(places.size() / 3), 3});
}

py::tuple bricks(const py::object& self, const std::string& name) {
  const auto& t = self.cast<const Tooth&>();
  return with_grid(t, name, [&](const auto& grid) {
    using Value = std::decay_t<decltype(grid.background())>;
    const Value* first = nullptr;
    const auto places = brick_places(grid, [&](std::size_t b) {
      if (!grid.is_uniform(b) && !first) first = grid.brick(b);
      return !grid.is_uniform(b);
    });
    constexpr py::ssize_t kEdge = kBrickEdge;
    const std::vector<py::ssize_t> shape = {places.shape(0), kEdge, kEdge, kEdge};
    if (!first) return py::make_tuple(places, py::array_t<Value>(shape));
    py::array_t<Value> values(shape, first, self);  // keeps the tooth
    values.attr("setflags")(py::arg("write") = false);
    return py::make_tuple(places, values);
  });
}

py::tuple tiles(const Tooth& t, const std::string& name) {
  return with_grid(t, name, [&](const auto& grid) {
    using Value = std::decay_t<decltype(grid.background())>;
    std::vector<Value> values;
    const auto places = brick_places(grid, [&](std::size_t b) {
      const bool wanted = grid.is_uniform(b) && grid.uniform_value(b) != grid.background();
      if (wanted) values.push_back(grid.uniform_value(b));
      return wanted;
    });
    return py::make_tuple(places, array_from(values, {static_cast<py::ssize_t>(values.size())}));
  });
}

py::array_t<double> vector(const Vec3& v) {
  return array_from(std::vector<double>{v.x(), v.y(), v.z()}, {3});
}

SurfaceOf surface_named(const std::string& name) {
  if (name == "all") return SurfaceOf::kAll;
  if (name == "enamel") return SurfaceOf::kEnamel;
  if (name == "dentin") return SurfaceOf::kDentin;
  if (name == "pulp") return SurfaceOf::kPulp;
  throw py::value_error("no surface '" + name + "'; there are all, enamel, dentin and pulp");
}

py::dict mesh(const Tooth& t, const std::string& tissue) {
  const SurfaceOf what = surface_named(tissue);
  TriangleMesh surface;
  {
    const py::gil_scoped_release released;
    surface = extract_surface(t.layers, what);
  }
  return arrays_of(surface);
}

void save(const Tooth& t, const py::object& path, bool overwrite) {
  const std::string name = path_of(path);
  const py::gil_scoped_release released;
  Outputs outputs(overwrite);
  const std::string file = outputs.file(name, {".vdb"});
  outputs.begin();
  write_tooth(t.layers, file);
  outputs.publish();
}

SharedTooth load(const py::object& path) {
  const std::string name = path_of(path);
  std::optional<ToothReading> reading;
  SharedTooth tooth;
  {
    const py::gil_scoped_release released;
    reading = read_tooth_with_warnings(name);
    tooth = std::make_shared<Tooth>(std::move(reading->tooth));
  }
  warn(reading->warnings);
  return tooth;
}

SharedTooth block(const py::object& size_mm, double enamel_mm, double voxel_mm) {
  BlockOptions options;
  const auto size = Doubles::ensure(size_mm);
  if (!size) throw py::type_error("size_mm must be a number or three");
  if (size.ndim() == 0)
    options.size = Vec3::Constant(size.data()[0]);
  else if (size.ndim() == 1 && size.shape(0) == 3)
    options.size = Vec3(size.data()[0], size.data()[1], size.data()[2]);
  else
    throw py::value_error("size_mm must be a number or three");
  options.enamel = enamel_mm;
  options.voxel = voxel_mm;
  const py::gil_scoped_release released;
  LayeredTooth tooth = make_block(options);
  tooth.provenance["source"] = "specimen block";
  tooth.provenance["axis_occlusal"] = "0 1 0";
  return std::make_shared<Tooth>(std::move(tooth));
}

SharedTooth molar(double voxel_mm, const py::object& progress) {
  const py::object callback = py::module_::import("toothprep._progress").attr("callback")(progress);
  SharedTooth tooth;
  run_long(callback, [&](Progress& p) {
    MolarOptions options;
    options.voxel = voxel_mm;
    options.progress = [&](double done) { p.report("molar", done); };
    tooth = std::make_shared<Tooth>(make_molar(options));
  });
  return tooth;
}

std::string repr(const Tooth& t) {
  const auto n = shape_of(t);
  return fmt::format("<toothprep.Tooth: {} x {} x {} voxels of {:.4g} mm>", n[0], n[1], n[2],
                     t.layers.lattice.voxel);
}

void bind_grids(py::class_<Tooth, std::shared_ptr<Tooth>>& type) {
  for (const char* name : kGrids) {
    const std::string grid = name;
    type.def_property_readonly(
        name, [grid](const Tooth& t) { return dense(t, grid, {}); },
        grid == "tissue" ? "The anatomy, which grinding never changes: a dense copy, (X, Y, Z) "
                           "uint8; 0 air, 1 enamel, 2 dentin, 3 pulp, 4 other. Raises SizeError, "
                           "before anything is allocated, if it needs more memory than there is."
                         : "What remains: a dense copy of the signed distance, (X, Y, Z) float32, "
                           "mm, negative inside, clamped to three voxels. Raises SizeError, before "
                           "anything is allocated, if it needs more memory than there is.");
  }
  type.def("dense", &dense, py::arg("name"), py::arg("limit_bytes") = py::none(),
           "A grid ('tissue', 'solid', 'enamel', 'dentin', 'pulp') as a dense copy, (X, Y, Z). "
           "Voxel [i, j, k] has its centre at origin_mm + voxel_mm * (i, j, k).\n\n"
           "Raises SizeError, before anything is allocated, if it takes more than limit_bytes "
           "(default: the memory that is free), ValueError for another name.");
  type.def("bricks", &bricks, py::arg("name"),
           "The stored bricks of a grid, without copying: (indices, values), indices (N, 3) int32, "
           "values (N, 8, 8, 8). Brick n holds what dense(name)[i:i+8, j:j+8, k:k+8] holds, with "
           "i, j, k = indices[n]. Other voxels are those of tiles(name), or the background: 0 in "
           "'tissue', +3 voxels in the level sets.\n\n"
           "The values are read-only and keep the tooth alive. A tooth never changes: a Session "
           "cuts a copy, so a view stays what it was. Raises ValueError for another name.");
  type.def("tiles", &tiles, py::arg("name"),
           "The bricks of a grid that hold one value other than the background and are not stored: "
           "(indices, values), (M, 3) int32 and (M,). Raises ValueError for another name.");
}

}  // namespace

Tooth::Tooth(LayeredTooth made) : layers(in_order(std::move(made))) {}

const LevelSet& Tooth::remains(std::size_t tissue) const {
  std::optional<LevelSet>& known = unpacked_[tissue];
  if (!known) known = layers.remains[tissue].unpacked();
  return *known;
}

py::dict arrays_of(const TriangleMesh& mesh) {
  const auto vertices = static_cast<py::ssize_t>(mesh.vertices.size()),
             triangles = static_cast<py::ssize_t>(mesh.triangles.size());
  py::array_t<float> points({vertices, py::ssize_t{3}});
  for (py::ssize_t v = 0; v < vertices; ++v)
    for (int a = 0; a < 3; ++a)
      points.mutable_at(v, a) = mesh.vertices[static_cast<std::size_t>(v)][a];
  py::array_t<std::uint32_t> corners({triangles, py::ssize_t{3}});
  for (py::ssize_t t = 0; t < triangles; ++t)
    for (std::size_t c = 0; c < 3; ++c)
      corners.mutable_at(t, static_cast<py::ssize_t>(c)) =
          mesh.triangles[static_cast<std::size_t>(t)][c];
  py::dict arrays;
  arrays["vertices"] = points;
  arrays["triangles"] = corners;
  arrays["tissue"] = array_from(mesh.tissue, {static_cast<py::ssize_t>(mesh.tissue.size())});
  return arrays;
}

void bind_teeth(py::module_& m) {
  py::class_<Tooth, std::shared_ptr<Tooth>> type(
      m, "Tooth",
      "A layered tooth; it never changes. Made by block(), molar(), load(), voxelize() and "
      "Session.remaining(). Lengths in mm, frame W (the scan's, LPS).");
  type.def_property_readonly(
      "voxel_mm", [](const Tooth& t) { return t.layers.lattice.voxel; }, "Voxel size, mm.");
  type.def_property_readonly(
      "origin_mm", [](const Tooth& t) { return vector(t.layers.lattice.to_world(first_voxel(t))); },
      "Centre of voxel [0, 0, 0] of the dense arrays, (3,), mm, W.");
  type.def_property_readonly(
      "shape", [](const Tooth& t) { return py::tuple(py::cast(shape_of(t))); },
      "Shape of the dense arrays: voxels along x, y, z.");
  type.def_property_readonly(
      "provenance", [](const Tooth& t) { return t.layers.provenance; },
      "What the tooth was made from: a dict of texts, kept in its file.");
  type.def_property_readonly(
      "volume_mm3", [](const Tooth& t) { return by_tissue(remaining_volumes_mm3(t.layers)); },
      "What remains of each tissue, mm^3: a dict by 'enamel', 'dentin', 'pulp', 'other'.");
  type.def_property_readonly(
      "bodies",
      [](const Tooth& t) {
        py::dict all;
        if (!t.layers.bodies) return all;
        const std::vector<double> volumes = body_volumes_mm3(t.layers);
        for (std::size_t b = 0; b < volumes.size(); ++b) {
          const Body& body = t.layers.bodies->list[b];
          py::dict d;
          d["kind"] = std::string(kBodyKindNames[static_cast<std::size_t>(body.kind)]);
          d["volume_mm3"] = volumes[b];
          all[py::str(body.name)] = d;
        }
        return all;
      },
      "Of a file with several bodies a dict by name: kind ('tooth', 'neighbour', 'gum') and "
      "volume_mm3, what remains; else empty.");
  type.def_property_readonly(
      "bounds_mm",
      [](const Tooth& t) {
        const Box box = bounds_of_solid(t.layers);
        return py::make_tuple(vector(box.min), vector(box.max));
      },
      "Box around what remains: (lower, upper), each (3,), mm, W.");
  type.def_property_readonly(
      "memory_bytes", [](const Tooth& t) { return memory_bytes(t.layers); },
      "Memory that the grids take, bytes.");
  type.def_property_readonly(
      "sha256", [](const Tooth& t) { return tooth_sha256(t.layers); },
      "SHA-256 over grids and transforms: the tooth_sha256 of traces and fits.");
  bind_grids(type);
  type.def(
      "mesh", &mesh, py::arg("tissue") = "all",
      "The closed surface of what remains of the tooth or of one tissue: a dict of vertices "
      "(V, 3) float32, mm, W; triangles (T, 3) uint32, counter-clockwise seen from outside; "
      "tissue (V,) uint8. ValueError for another name than 'all', 'enamel', 'dentin', 'pulp'.");
  type.def("save", &save, py::arg("path"), py::arg("overwrite") = true,
           "Writes a tooth file (.vdb) that any OpenVDB program reads; whole or not at all. Same "
           "tooth, same bytes. Raises Error if it can't be written, or exists and overwrite is "
           "False.");
  type.def("__repr__", &repr);

  m.def("load", &load, py::arg("path"),
        "Reads a tooth file (.vdb). What is odd about it, though it can be read, is a UserWarning. "
        "A file that another program wrote is first read by a child process with limits on time "
        "and memory, since OpenVDB's reader trusts what it finds.\n\n"
        "Raises Error (file, grid, condition) for what is no tooth.");
  m.def("block", &block, py::arg("size_mm") = 8.0, py::arg("enamel_mm") = 2.0,
        py::arg("voxel_mm") = 0.1,
        "The paper's layered block: enamel on dentin, top face at y = 0, centred in x and z.\n\n"
        "size_mm: a number, or (x, y, z). enamel_mm: thickness of the enamel, 0 to the height. "
        "Raises Error for what is out of range.");
  m.def(
      "molar", &molar, py::arg("voxel_mm") = 0.1, py::arg("progress") = py::none(),
      "An anatomical lower left first molar: enamel cap, dentin, pulp; crown to +z, buccal +x, "
      "mesial -y. voxel_mm from 0.02 to 0.5, else Error; at 0.05 it takes some ten seconds. "
      "progress: True for a line on stderr, or a function called as progress(stage, done). Ctrl-C "
      "ends it.");
}

}  // namespace toothprep::python
