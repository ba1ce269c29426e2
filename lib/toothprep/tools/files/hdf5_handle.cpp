#include "toothprep/tools/files/hdf5_handle.h"

#include <hdf5.h>

#include <type_traits>

namespace toothprep::h5 {

static_assert(std::is_same_v<hid_t, Id> && std::is_same_v<herr_t, int>);
static_assert(H5I_INVALID_HID == -1);

Quiet::Quiet() {
  static const herr_t once = H5dont_atexit();
  static_cast<void>(once);
  H5Eget_auto2(H5E_DEFAULT, &function_, &data_);
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
}

Quiet::~Quiet() { H5Eset_auto2(H5E_DEFAULT, function_, data_); }

std::unique_lock<std::mutex> lock_hdf5() {
  static std::mutex mutex;
  return std::unique_lock(mutex);
}

}  // namespace toothprep::h5
