// What the files of the Python module share. One file per subject; each adds its classes and
// functions to the module `toothprep._core`, which the package's Python files make the public face of.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/core/parameters.h"
#include "toothprep/step/core/step_record.h"
#include "toothprep/step/tooth/layered_tooth.h"
#include "toothprep/tools/mesh/surface.h"

namespace toothprep::python {

namespace py = pybind11;

// A tooth as Python holds it: never changed once it is made, so that views of its bricks stay what
// they are and sessions on several threads may share it.
struct Tooth {
  explicit Tooth(LayeredTooth made);
  const LayeredTooth
      layers;  // its bricks stand in the pool in the order of the table, without gaps
  // What remains of a tissue (0 to 2), likewise; made when it is first asked for. Under the GIL.
  const LevelSet& remains(std::size_t tissue) const;

 private:
  mutable std::array<std::optional<LevelSet>, 3> unpacked_;
};
using SharedTooth = std::shared_ptr<Tooth>;

struct BurObject {
  std::string spec;
  Bur bur;
};
using SharedBur = std::shared_ptr<BurObject>;

using Doubles = py::array_t<double, py::array::c_style | py::array::forcecast>;

void bind_errors(py::module_& m);
void bind_teeth(py::module_& m);
void bind_burs(py::module_& m);
void bind_parameters(py::module_& m);
void bind_sessions(py::module_& m);
void bind_traces(py::module_& m);
void bind_voxelize(py::module_& m);
void bind_calibrate(py::module_& m);
void bind_score(py::module_& m);
void bind_render(py::module_& m);

// From a dict shaped as the parameter file, a path, a preset's name, or None (preset "paper").
Parameters parameters_of(const py::object& given);

// A Bur, or what toothprep.Bur() takes.
SharedBur bur_of(const py::object& given);

// str or os.PathLike.
std::string path_of(const py::object& path);

// {"vertices": (V, 3) float32, "triangles": (T, 3) uint32, "tissue": (V,) uint8}
py::dict arrays_of(const TriangleMesh& mesh);

// The rows as arrays under the trace's dataset names ("force/device").
py::dict arrays_of(const std::vector<StepRecord>& rows);
py::array loads_of(const std::vector<StepRecord>& rows);  // (T, 3) N
py::array body_areas_of(const std::vector<StepRecord>& rows,
                        const std::vector<Body>& bodies);  // (T, B) mm²

py::dict by_tissue(const PerTissue<double>& values);

// UserWarnings. Throws py::error_already_set if Python makes them errors.
void warn(const std::vector<std::string>& warnings);

// The elements of an array as a new one of the given shape.
template <class T>
py::array_t<T> array_from(const std::vector<T>& values, std::vector<py::ssize_t> shape) {
  py::array_t<T> array(std::move(shape));
  std::copy(values.begin(), values.end(), array.mutable_data());
  return array;
}

}  // namespace toothprep::python
