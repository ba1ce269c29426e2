// Keyword arguments, as the package's functions hand them on in a dict that has every key.
#pragma once

#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <array>
#include <optional>
#include <string>

#include "toothprep/step/core/geometry.h"

namespace toothprep::python {

// The value of `key` as a T; TypeError naming the argument if it is none.
template <class T>
T taken(const pybind11::dict& options, const char* key) {
  const pybind11::object value = options[key];
  try {
    return value.cast<T>();
  } catch (const pybind11::cast_error&) {
    throw pybind11::type_error(std::string(key) + " can't be " +
                               pybind11::repr(value).cast<std::string>());
  }
}

// Three numbers, or nothing where it is None.
inline std::optional<Vec3> vector_taken(const pybind11::dict& options, const char* key) {
  const auto v = taken<std::optional<std::array<double, 3>>>(options, key);
  if (!v) return {};
  return Vec3((*v)[0], (*v)[1], (*v)[2]);
}

// One of the named choices.
template <class T, std::size_t N>
T choice_taken(const pybind11::dict& options, const char* key,
               const std::array<std::pair<const char*, T>, N>& choices) {
  const auto name = taken<std::string>(options, key);
  std::string names;
  for (const auto& [known, value] : choices) {
    if (name == known) return value;
    names += (names.empty() ? "'" : ", '") + std::string(known) + "'";
  }
  throw pybind11::value_error(std::string(key) + " is one of " + names + ", not '" + name + "'");
}

}  // namespace toothprep::python
