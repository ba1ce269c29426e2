// The vendor's device library, opened at run time: a program built without it runs with it.
#pragma once

#include <string>

#include "toothprep/tools/device/hdapi.h"

namespace toothprep::hdapi {

struct LibHd {
  std::string path;  // as it was asked for
#define TOOTHPREP_MEMBER(result, name, parameters) result(*name) parameters = nullptr;
  TOOTHPREP_HDAPI_FUNCTIONS(TOOTHPREP_MEMBER)
#undef TOOTHPREP_MEMBER
};

// `library`, if it isn't empty; else the one that $TOOTHPREP_LIBHD names; else the first of
// libHD.so, libHD.so.3.4 and libHD.so.3.0 that the system finds. One that was named and can't be
// opened is an error, not a reason to take another. The library stays open for the life of the
// process: the driver fails when it is loaded a second time. Throws Error that says what was tried
// and what to install.
LibHd load_libhd(const std::string& library = {});

}  // namespace toothprep::hdapi
