// Burs: outline, surface elements, exact distance.
#include <fmt/format.h>

#include "bindings.h"
#include "toothprep/step/bur/bur_library.h"

namespace toothprep::python {
namespace {

std::string library_folder() {
  return py::module_::import("toothprep._data").attr("data_folder")().cast<std::string>() + "/burs";
}

std::shared_ptr<BurObject> make(const py::object& spec) {
  const std::string text = path_of(spec);
  return std::make_shared<BurObject>(BurObject{text, make_bur(text, library_folder())});
}

py::array_t<double> columns(const std::vector<const std::vector<float>*>& of) {
  const auto rows = static_cast<py::ssize_t>(of.front()->size());
  py::array_t<double> out({rows, static_cast<py::ssize_t>(of.size())});
  for (py::ssize_t i = 0; i < rows; ++i)
    for (std::size_t c = 0; c < of.size(); ++c)
      out.mutable_at(i, static_cast<py::ssize_t>(c)) = (*of[c])[static_cast<std::size_t>(i)];
  return out;
}

py::array_t<double> column(const std::vector<float>& of) {
  return array_from(std::vector<double>(of.begin(), of.end()),
                    {static_cast<py::ssize_t>(of.size())});
}

py::dict elements(const BurObject& b, double size_mm, bool clockwise) {
  const SurfaceElements e = b.bur.elements(size_mm, clockwise);
  const std::vector<float> zero(e.size(), 0.0F);
  py::dict arrays;
  arrays["position_mm"] = columns({&e.x, &e.y, &e.z});
  arrays["normal"] = columns({&e.nx, &e.ny, &e.nz});
  arrays["tangent"] = columns({&e.tx, &e.ty, &zero});
  arrays["weight_mm"] = column(e.weight);
  arrays["area_mm2"] = column(e.area);
  arrays["radius_mm"] = column(e.radius);
  arrays["half_along_mm"] = column(e.half_along);
  arrays["half_around_mm"] = column(e.half_around);
  return arrays;
}

py::list profile(const BurObject& b) {
  py::list pieces;
  for (const ProfilePiece& p : b.bur.profile()) {
    py::dict piece;
    const bool arc = p.kind == ProfilePiece::Kind::kArc;
    piece["kind"] = arc ? "arc" : "line";
    piece["from_mm"] = py::make_tuple(p.r0, p.z0);
    piece["to_mm"] = py::make_tuple(p.r1, p.z1);
    piece["grinds"] = p.grinds;
    if (arc) {
      piece["centre_mm"] = py::make_tuple(p.centre_r, p.centre_z);
      piece["convex"] = p.convex;
    }
    pieces.append(piece);
  }
  return pieces;
}

py::list library() {
  py::list entries;
  for (const LibraryEntry& entry : list_library(library_folder())) {
    py::dict d;
    d["name"] = entry.name;
    d["also"] = entry.also;
    d["shape"] = entry.shape;
    d["description"] = entry.description;
    d["source"] = entry.source;
    entries.append(d);
  }
  return entries;
}

}  // namespace

SharedBur bur_of(const py::object& given) {
  if (py::isinstance<BurObject>(given)) return given.cast<std::shared_ptr<BurObject>>();
  return make(given);
}

void bind_burs(py::module_& m) {
  py::class_<BurObject, std::shared_ptr<BurObject>> type(
      m, "Bur",
      "A bur: a solid of revolution about its own +z, tip at the origin, shank up (frame B, mm).");
  type.def(py::init(&make), py::arg("spec"),
           "spec: 'cylinder:D1.2xL3.0', 'ball:D1.2', ..., a name of the library (see burs()), or "
           "the path of a profile file. Raises Error for what is none of them.");
  type.def_property_readonly(
      "spec", [](const BurObject& b) { return b.spec; }, "The text that it was made from.");
  type.def_property_readonly(
      "name", [](const BurObject& b) { return b.bur.name(); },
      "Its name in the library or profile file, or its shorthand.");
  type.def_property_readonly(
      "head_length_mm", [](const BurObject& b) { return b.bur.head_length(); },
      "Length of the head, mm.");
  type.def_property_readonly(
      "max_radius_mm", [](const BurObject& b) { return b.bur.max_radius(); },
      "Largest radius of the head, mm.");
  type.def_property_readonly(
      "shank_radius_mm", [](const BurObject& b) { return b.bur.shank_radius(); },
      "Radius of the shank, mm; 0: none.");
  type.def_property_readonly(
      "shank_top_mm", [](const BurObject& b) { return b.bur.shank_top(); },
      "Where the shank ends, mm along z.");
  type.def_property_readonly(
      "head_volume_mm3", [](const BurObject& b) { return b.bur.head_volume(); },
      "Volume of the head, mm^3, exact.");
  type.def_property_readonly(
      "grinding_area_mm2", [](const BurObject& b) { return b.bur.grinding_area(); },
      "Area of what grinds, mm^2, exact.");
  type.def_property_readonly(
      "profile", &profile,
      "The head's outline from the tip up, a list of dicts: kind 'line' or 'arc', from_mm and "
      "to_mm (r, z), grinds; of arcs also centre_mm (r, z) and convex.");
  type.def(
      "elements", &elements, py::arg("size_mm") = 0.1, py::arg("clockwise") = true,
      "The grinding surface in elements of at most size_mm, a dict of arrays, one row each, "
      "in B: position_mm, normal (outward), tangent (opposite to the surface's velocity) "
      "(N, 3); weight_mm (dphi dl), area_mm2, radius_mm, half_along_mm, half_around_mm (N,).\n\n"
      "Raises Error for a size outside 1e-4 to 10 mm.");
  type.def(
      "distance_mm",
      [](const BurObject& b, const py::object& r, const py::object& z) {
        return py::vectorize([&b](double r_mm, double z_mm) { return b.bur.distance(r_mm, z_mm); })(
            Doubles::ensure(r), Doubles::ensure(z));
      },
      py::arg("r_mm"), py::arg("z_mm"),
      "Exact signed distance to the head's surface, mm, negative inside, of points at the radius "
      "r_mm >= 0 and height z_mm; numbers or arrays that broadcast.");
  type.def("__repr__", [](const BurObject& b) { return "toothprep.Bur('" + b.spec + "')"; });

  m.def("burs", &library,
        "The bur library: a list of dicts name, also (another name), shape (a shorthand), "
        "description, source (where the dimensions come from).");
}

}  // namespace toothprep::python
