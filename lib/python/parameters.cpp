// Parameters: from a dict, a file or a preset, and back as a dict.
#include <toml++/toml.h>

#include <algorithm>
#include <sstream>

#include "bindings.h"
#include "toothprep/step/core/errors.h"

namespace toothprep::python {
namespace {

py::dict dict_of(const toml::table& table) {
  py::dict out;
  for (const auto& [key, value] : table) {
    const py::str name(std::string(key.str()));
    if (const auto* inner = value.as_table())
      out[name] = dict_of(*inner);
    else if (const auto* text = value.as_string())
      out[name] = text->get();
    else if (const auto* flag = value.as_boolean())
      out[name] = flag->get();
    else if (const auto* whole = value.as_integer())
      out[name] = whole->get();
    else if (const auto* number = value.as_floating_point())
      out[name] = number->get();
  }
  return out;
}

py::dict complete(const py::object& given) {
  return dict_of(toml::parse(to_toml(parameters_of(given))));
}

}  // namespace

Parameters parameters_of(const py::object& given) {
  if (given.is_none()) return preset_parameters("paper");
  if (py::isinstance<py::dict>(given)) {
    const py::object text = py::module_::import("toothprep._toml").attr("toml_text")(given);
    return parse_parameters(text.cast<std::string>(), "parameters");
  }
  const std::string name = path_of(given);
  if (std::find(std::begin(kPresets), std::end(kPresets), name) != std::end(kPresets))
    return preset_parameters(name);
  try {
    return read_parameters(name);
  } catch (const InputError& e) {
    const bool is_name = name.find_first_of("./") == std::string::npos;
    if (!is_name) throw;
    throw InputError(
        name, e.place(), e.condition(),
        "give a parameter file, or one of the presets 'paper', 'physical' and 'literature'");
  }
}

void bind_parameters(py::module_& m) {
  m.def("parameters", &complete, py::arg("given") = py::none(),
        "All parameters as a dict shaped as the parameter file (data/parameters), what is not "
        "given filled in.\n\n"
        "given: such a dict with some of the keys, the path of a parameter file, a preset's name "
        "('paper', 'physical', 'literature'), or None for 'paper'. Raises Error that names the key "
        "for what is "
        "unknown or out of range.");
}

}  // namespace toothprep::python
