// The toolkit's errors as toothprep.Error, with their parts as attributes.
#include "toothprep/step/core/errors.h"

#include "bindings.h"
#include "toothprep/tools/io/part.h"

namespace toothprep::python {
namespace {

// Bytes of a file's name may be no UTF-8.
py::str text_of(const std::string& bytes) {
  return py::reinterpret_steal<py::str>(
      PyUnicode_DecodeUTF8(bytes.data(), static_cast<py::ssize_t>(bytes.size()), "replace"));
}

void raise(const std::string& text, const std::string& file, const std::string& place,
           const std::string& condition, const std::string& remedy) {
  const py::object type = py::module_::import("toothprep._errors").attr("Error");
  const py::object error = type(text_of(with_shown_names(text)), text_of(with_shown_names(file)),
                                text_of(place), text_of(condition), text_of(remedy));
  PyErr_SetObject(type.ptr(), error.ptr());
}

}  // namespace

void bind_errors(py::module_&) {
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const InputError& e) {
      raise(e.what(), e.file(), e.place(), e.condition(), e.remedy());
    } catch (const Error& e) {
      raise(e.what(), {}, {}, e.what(), {});
    }
  });
}

}  // namespace toothprep::python
