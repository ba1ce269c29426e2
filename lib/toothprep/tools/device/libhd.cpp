#include "toothprep/tools/device/libhd.h"

#include <dlfcn.h>

#include <cstdlib>
#include <vector>

#include "toothprep/step/core/errors.h"

namespace toothprep::hdapi {
namespace {

std::string last_error() {
  const char* text = dlerror();
  return text ? text : "unknown error";
}

template <class Function>
void bind(void* handle, const std::string& path, const char* name, Function*& function) {
  function = reinterpret_cast<Function*>(dlsym(handle, name));
  if (!function)
    throw Error("openhaptics: " + path + " has no function " + name +
                ", so it is not the libHD of OpenHaptics 3.0 or newer; install that, or set "
                "TOOTHPREP_LIBHD to the right file");
}

}  // namespace

LibHd load_libhd(const std::string& library) {
  const char* const named = std::getenv("TOOTHPREP_LIBHD");
  std::vector<std::string> candidates = {"libHD.so", "libHD.so.3.4", "libHD.so.3.0"};
  if (!library.empty())
    candidates = {library};
  else if (named && *named)
    candidates = {named};

  std::string tried;
  for (const std::string& path : candidates) {
    // Lazily, since the vendor's libraries need symbols that not every installation has; locally,
    // since theirs are none of ours.
    void* const handle = dlopen(path.c_str(), RTLD_LAZY | RTLD_LOCAL);
    if (!handle) {
      tried += (tried.empty() ? "" : "; ") + path + " (" + last_error() + ")";
      continue;
    }
    LibHd lib;
    lib.path = path;
#define TOOTHPREP_BIND(result, name, parameters) bind(handle, path, #name, lib.name);
    TOOTHPREP_HDAPI_FUNCTIONS(TOOTHPREP_BIND)
#undef TOOTHPREP_BIND
    return lib;
  }
  throw Error("openhaptics: the device library could not be opened, tried " + tried +
              "; install the device's driver and OpenHaptics for Linux, or set TOOTHPREP_LIBHD to "
              "a libHD.so (without a device: to the stand-in built with toothprep)");
}

}  // namespace toothprep::hdapi
