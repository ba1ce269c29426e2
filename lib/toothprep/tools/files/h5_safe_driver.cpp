#include "toothprep/tools/files/h5_safe_driver.h"

#include <fcntl.h>
#include <hdf5.h>
#include <libdeflate.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#if __has_include(<H5FDdevelop.h>)
#include <H5FDdevelop.h>
#endif

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <new>
#include <string>

namespace toothprep::h5 {
namespace {

constexpr std::array<char, 8> kMark = {'t', 'p', ' ', 's', 'a', 'v', 'e', 'd'};
constexpr int kLooks = 1000;                     // at most, at a file whose end changes at each
constexpr std::uint64_t kMostSaved = 64u << 20;  // bytes, far more than any block of HDF5's own

// The file's last bytes while the `size` bytes before them are being written at `address`.
struct Saved {
  std::array<char, 8> mark{};
  std::uint64_t address = 0, size = 0;
  std::uint64_t checksum = 0;  // of the bytes, address and size

  bool operator==(const Saved&) const = default;
};
static_assert(sizeof(Saved) == 32);

std::uint64_t checksum_of(std::uint64_t address, const std::string& bytes) {
  const std::array<std::uint64_t, 2> place = {address, bytes.size()};
  return libdeflate_crc32(libdeflate_crc32(0, place.data(), sizeof place), bytes.data(),
                          bytes.size());
}

// HDF5's part comes first: it is given its address.
struct File {
  H5FD_t hdf5{};
  int descriptor = -1;
  bool writes = false;
  haddr_t allocated = 0, end = 0;  // what HDF5 has handed out; what was written
  // Of a file that is only read: what stood at its end at the last look, and its bytes.
  Saved saved;
  std::string bytes;
};
static_assert(std::is_standard_layout_v<File>);

File& of(H5FD_t* file) { return *reinterpret_cast<File*>(file); }
const File& of(const H5FD_t* file) { return *reinterpret_cast<const File*>(file); }

haddr_t size_of(const File& file) {
  struct stat state {};
  return fstat(file.descriptor, &state) == 0 ? static_cast<haddr_t>(state.st_size) : 0;
}

// Zeros beyond the end, as from HDF5's own driver.
bool read_at(const File& file, haddr_t address, std::size_t size, char* bytes) {
  while (size > 0) {
    const ssize_t done = pread(file.descriptor, bytes, size, static_cast<off_t>(address));
    if (done < 0 && errno == EINTR) continue;
    if (done < 0) return false;
    if (done == 0) {
      std::memset(bytes, 0, size);
      return true;
    }
    bytes += done;
    address += static_cast<haddr_t>(done);
    size -= static_cast<std::size_t>(done);
  }
  return true;
}

bool write_at(const File& file, haddr_t address, std::size_t size, const char* bytes) {
  while (size > 0) {
    const ssize_t done = pwrite(file.descriptor, bytes, size, static_cast<off_t>(address));
    if (done < 0 && errno == EINTR) continue;
    if (done < 0) return false;
    bytes += done;
    address += static_cast<haddr_t>(done);
    size -= static_cast<std::size_t>(done);
  }
  return true;
}

// Also true of what has no size: GrowingWriter::abandon() puts /dev/null in the file's place.
bool cut(const File& file, haddr_t size) {
  return ftruncate(file.descriptor, static_cast<off_t>(size)) == 0 || errno == EINVAL;
}

// What the file's last bytes say; nothing if they are others.
Saved at_the_end_of(const File& file) {
  const haddr_t size = size_of(file);
  Saved saved;
  if (size < sizeof saved ||
      !read_at(file, size - sizeof saved, sizeof saved, reinterpret_cast<char*>(&saved)) ||
      saved.mark != kMark || saved.size > std::min<haddr_t>(kMostSaved, size - sizeof saved))
    return {};
  return saved;
}

void take(File& file, const Saved& saved) {
  if (saved == file.saved) return;
  file.saved = {};
  file.bytes.clear();
  file.bytes.resize(saved.size);
  const haddr_t size = size_of(file);
  if (size < saved.size + sizeof saved ||
      !read_at(file, size - sizeof saved - saved.size, saved.size, file.bytes.data()) ||
      checksum_of(saved.address, file.bytes) != saved.checksum)
    file.bytes.clear();  // not all of it was written
  file.saved = saved;
}

// HDF5 is C: no exception may pass through it.
template <class F>
auto unless_memory_fails(const F& f, decltype(f()) failed) {
  try {
    return f();
  } catch (const std::bad_alloc&) {
    return failed;
  }
}

H5FD_t* open_file(const char* name, unsigned flags, hid_t, haddr_t) {
  std::unique_ptr<File> file(new (std::nothrow) File);
  if (!file) return nullptr;
  file->writes = (flags & H5F_ACC_RDWR) != 0;
  file->descriptor = open(
      name,
      (file->writes ? O_RDWR : O_RDONLY) | O_CLOEXEC | ((flags & H5F_ACC_TRUNC) ? O_TRUNC : 0) |
          ((flags & H5F_ACC_CREAT) ? O_CREAT : 0) | ((flags & H5F_ACC_EXCL) ? O_EXCL : 0),
      0666);
  if (file->descriptor < 0) return nullptr;
  file->end = size_of(*file);
  return &file.release()->hdf5;
}

herr_t close_file(H5FD_t* hdf5) {
  const std::unique_ptr<File> file(&of(hdf5));
  return close(file->descriptor);
}

herr_t query(const H5FD_t*, unsigned long* flags) {
  *flags = H5FD_FEAT_AGGREGATE_METADATA | H5FD_FEAT_ACCUMULATE_METADATA | H5FD_FEAT_DATA_SIEVE |
           H5FD_FEAT_AGGREGATE_SMALLDATA | H5FD_FEAT_POSIX_COMPAT_HANDLE |
           H5FD_FEAT_SUPPORTS_SWMR_IO | H5FD_FEAT_DEFAULT_VFD_COMPATIBLE;
  return 0;
}

haddr_t get_eoa(const H5FD_t* hdf5, H5FD_mem_t) { return of(hdf5).allocated; }

herr_t set_eoa(H5FD_t* hdf5, H5FD_mem_t, haddr_t address) {
  of(hdf5).allocated = address;
  return 0;
}

haddr_t get_eof(const H5FD_t* hdf5, H5FD_mem_t) { return of(hdf5).end; }

herr_t get_handle(H5FD_t* hdf5, hid_t, void** handle) {
  *handle = &of(hdf5).descriptor;
  return 0;
}

herr_t read_block(File& file, H5FD_mem_t kind, haddr_t address, std::size_t size, char* bytes) {
  if (file.writes || kind == H5FD_MEM_DRAW) return read_at(file, address, size, bytes) ? 0 : -1;
  // Its writer may be at work: what stood at the end counts if it still does. (HDF5 reads a block
  // again whose checksum doesn't hold.)
  for (int look = 0; look < kLooks; ++look) {
    const Saved saved = at_the_end_of(file);
    take(file, saved);
    if (!read_at(file, address, size, bytes)) return -1;
    const haddr_t first = std::max<haddr_t>(address, saved.address),
                  last = std::min<haddr_t>(address + size, saved.address + file.bytes.size());
    if (first < last)
      std::memcpy(bytes + (first - address), file.bytes.data() + (first - saved.address),
                  last - first);
    if (file.bytes.empty() || at_the_end_of(file) == saved) break;
  }
  return 0;
}

herr_t read_file(H5FD_t* hdf5, H5FD_mem_t kind, hid_t, haddr_t address, size_t size, void* buffer) {
  return unless_memory_fails(
      [&] { return read_block(of(hdf5), kind, address, size, static_cast<char*>(buffer)); }, -1);
}

herr_t write_block(File& file, H5FD_mem_t kind, haddr_t address, std::size_t size,
                   const char* bytes) {
  const haddr_t end = std::max<haddr_t>(file.end, address + size);
  const bool in_place = address < file.end && kind != H5FD_MEM_DRAW;
  if (in_place) {
    std::string copy(bytes, size);
    const Saved saved{kMark, address, size, checksum_of(address, copy)};
    copy.append(reinterpret_cast<const char*>(&saved), sizeof saved);
    if (!write_at(file, end, copy.size(), copy.data())) {
      static_cast<void>(cut(file, file.end));
      return -1;
    }
  }
  if (!write_at(file, address, size, bytes)) return -1;
  file.end = end;
  return !in_place || cut(file, end) ? 0 : -1;
}

herr_t write_file(H5FD_t* hdf5, H5FD_mem_t kind, hid_t, haddr_t address, size_t size,
                  const void* buffer) {
  return unless_memory_fails(
      [&] { return write_block(of(hdf5), kind, address, size, static_cast<const char*>(buffer)); },
      -1);
}

// To what HDF5 has handed out.
herr_t truncate_file(H5FD_t* hdf5, hid_t, hbool_t) {
  File& file = of(hdf5);
  if (!file.writes || file.end == file.allocated) return 0;
  if (!cut(file, file.allocated)) return -1;
  file.end = file.allocated;
  return 0;
}

// HDF5 marks a file as being written, or looks whether it is, only if the driver has locks.
herr_t lock_file(H5FD_t* hdf5, hbool_t to_write) {
  return flock(of(hdf5).descriptor, (to_write ? LOCK_EX : LOCK_SH) | LOCK_NB) == 0 ||
                 errno == ENOSYS
             ? 0
             : -1;
}

herr_t unlock_file(H5FD_t* hdf5) {
  return flock(of(hdf5).descriptor, LOCK_UN) == 0 || errno == ENOSYS ? 0 : -1;
}

H5FD_class_t driver() {
  constexpr std::array<H5FD_mem_t, H5FD_MEM_NTYPES> kFreeLists = H5FD_FLMAP_DICHOTOMY;
  H5FD_class_t c{};
#ifdef H5FD_CLASS_VERSION
  c.version = H5FD_CLASS_VERSION;
  c.value = static_cast<H5FD_class_value_t>(300);  // of those that nobody has registered
#endif
  c.name = "toothprep";
  c.maxaddr = static_cast<haddr_t>(std::numeric_limits<off_t>::max());
  c.fc_degree = H5F_CLOSE_WEAK;
  c.open = open_file;
  c.close = close_file;
  c.query = query;
  c.get_eoa = get_eoa;
  c.set_eoa = set_eoa;
  c.get_eof = get_eof;
  c.get_handle = get_handle;
  c.read = read_file;
  c.write = write_file;
  c.truncate = truncate_file;
  c.lock = lock_file;
  c.unlock = unlock_file;
  std::copy(kFreeLists.begin(), kFreeLists.end(), std::begin(c.fl_map));
  return c;
}

}  // namespace

int use_safe_driver(Id access) {
  static const H5FD_class_t its = driver();
  static const hid_t id = H5FDregister(&its);
  return id < 0 ? -1 : H5Pset_driver(access, id, nullptr);
}

}  // namespace toothprep::h5
