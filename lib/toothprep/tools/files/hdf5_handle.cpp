#include "toothprep/tools/files/hdf5_handle.h"

#include <hdf5.h>

#include <type_traits>

namespace toothprep::h5 {

static_assert(std::is_same_v<hid_t, Id> && std::is_same_v<herr_t, int>);
static_assert(H5I_INVALID_HID == -1);

std::optional<std::vector<std::string>> texts_of(const Handle& attribute, std::int64_t most) {
  if (!attribute) return {};
  const Handle type(H5Aget_type(attribute.get()), H5Tclose);
  const Handle space(H5Aget_space(attribute.get()), H5Sclose);
  const std::int64_t count = H5Sget_simple_extent_npoints(space.get());
  if (H5Tis_variable_str(type.get()) <= 0 || count < 1 || count > most) return {};
  const Handle memory(H5Tcopy(H5T_C_S1), H5Tclose);
  H5Tset_size(memory.get(), H5T_VARIABLE);
  H5Tset_cset(memory.get(), H5Tget_cset(type.get()));
  std::vector<char*> all(static_cast<std::size_t>(count), nullptr);
  if (H5Aread(attribute.get(), memory.get(), all.data()) < 0) return {};
  std::vector<std::string> texts;
  for (char* text : all) {
    texts.emplace_back(text ? text : "");
    if (text) H5free_memory(text);
  }
  return texts;
}

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
