// The module toothprep._core: what every part of it needs, and the list of the parts.
#include <tbb/global_control.h>

#include <memory>

#include "bindings.h"
#include "toothprep/build_info.h"
#include "toothprep/version.h"

namespace toothprep::python {

std::string path_of(const py::object& path) {
  const py::object text = py::module_::import("os").attr("fspath")(path);  // TypeError otherwise
  return py::module_::import("os").attr("fsencode")(text).cast<std::string>();
}

py::dict by_tissue(const PerTissue<double>& values) {
  py::dict named;
  for (int k = 0; k < kTissueCount; ++k) named[py::str(std::string(kTissueNames[k]))] = values[k];
  return named;
}

void warn(const std::vector<std::string>& warnings) {
  for (const std::string& text : warnings)
    if (PyErr_WarnEx(PyExc_UserWarning, text.c_str(), 1) != 0) throw py::error_already_set();
}

void set_threads(int threads) {
  static std::unique_ptr<tbb::global_control> limit;
  if (threads < 0) throw py::value_error("a number of threads, or 0 for all cores");
  limit.reset();
  if (threads > 0)
    limit = std::make_unique<tbb::global_control>(tbb::global_control::max_allowed_parallelism,
                                                  static_cast<std::size_t>(threads));
}

}  // namespace toothprep::python

PYBIND11_MODULE(_core, m) {
  using namespace toothprep::python;
  m.doc() = "The compiled part of toothprep; use the package, which documents it.";
  m.attr("version") = toothprep::kVersion;
  m.attr("source_data_folder") = std::string(toothprep::kSourceFolder) + "/data";
  m.def("set_threads", &set_threads, pybind11::arg("threads"),
        "Threads of offline work (voxelize, render, ...) from now on; 0: all cores. Results don't "
        "depend on it. A session steps on one thread. ValueError for less than 0.");
  bind_errors(m);
  bind_teeth(m);
  bind_burs(m);
  bind_parameters(m);
  bind_traces(m);
  bind_sessions(m);
  bind_voxelize(m);
  bind_calibrate(m);
  bind_score(m);
  bind_render(m);
}
