#include "toothprep/step/core/regular_file.h"

#include <filesystem>

#include "toothprep/step/core/errors.h"

namespace toothprep {
namespace fs = std::filesystem;

std::uint64_t regular_file_size(const std::string& path) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  switch (status.type()) {
    case fs::file_type::regular:
      break;
    case fs::file_type::not_found:
      throw InputError(path, "", "does not exist");
    case fs::file_type::directory:
      throw InputError(path, "", "is a folder, not a regular file", "give a file");
    case fs::file_type::fifo:
      throw InputError(path, "", "is a FIFO or pipe, not a regular file",
                       "write the data to a file first");
    case fs::file_type::character:
    case fs::file_type::block:
      throw InputError(path, "", "is a device, not a regular file", "give a file");
    case fs::file_type::none:
    case fs::file_type::unknown:
      throw InputError(path, "", "cannot be read: " + error.message());
    default:
      throw InputError(path, "", "is not a regular file", "give a file");
  }
  const std::uintmax_t size = fs::file_size(path, error);
  if (error) throw InputError(path, "", "cannot be read: " + error.message());
  return size;
}

}  // namespace toothprep
