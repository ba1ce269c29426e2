// Typed reads of an HDF5 file that may be damaged, someone else's, or still growing: size and type
// are looked at before anything is allocated, and every refusal names file, dataset and condition.
//
// A file that a recorder still writes, or whose recorder was killed, is opened as HDF5's SWMR
// readers do. Its datasets may differ by a tail that was not written any more: rows are cut to the
// shortest (cut_to_shortest), and where /time stops increasing. If rows lie beyond the end of the
// file, which HDF5 would read as zeros, the file was cut off and is refused.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/geometry.h"
#include "toothprep/tools/files/h5_packing.h"
#include "toothprep/tools/files/hdf5_handle.h"
#include "toothprep/tools/io/read_policy.h"

namespace toothprep::h5 {

// As every reader does, or else as SWMR readers do; no file: it can't be.
struct OpenFile {
  Handle file;
  bool shared = false;  // opened as SWMR readers do: marked as being written
};
OpenFile open_to_read(const std::string& path);

// Who unpacks chunks that are packed as Writer does: HDF5, or h5_packing.h.
enum class Unpacking { kByHdf5, kHere };

// A chunk that h5_packing.h can't unpack: HDF5 has to tell what is wrong with it, after a trial.
struct CannotUnpack {};

class Reader {
 public:
  explicit Reader(const std::string& path, Unpacking unpacking = Unpacking::kByHdf5,
                  bool trial = false);

  // Opened by a child process that finds out whether HDF5 can read the file (read_with_care): what
  // is made of the values is lost, so they needn't be put together.
  bool trial() const { return trial_; }

  [[noreturn]] void refuse(const std::string& place, const std::string& condition,
                           const std::string& remedy = {}) const;

  // Being written, or left by a recorder that was killed.
  bool growing() const { return growing_; }

  // A recording that said, when it was opened, that it is closed.
  bool complete() const { return complete_; }

  // Also false for a link that leads nowhere.
  bool has(const std::string& name) const;

  // In a growing file: no more rows than the shortest of these (of those that are there).
  void cut_to_shortest(const std::vector<std::string>& names);

  // The rows of `name`, whose other extent must be `width`; checks everything that can be checked
  // before a byte is allocated. Fixes the number of rows at the first call.
  struct Set {
    Handle handle;
    std::string name;
    int width = 0;
    std::size_t rows = 0;      // of the file
    std::vector<int> tissues;  // of each column, where there are any
  };
  Set open(const std::string& name, const char* unit, int width, bool unit_required,
           bool per_tissue = false);

  // Refuses the file if it isn't what its lists of checksums say (h5_checksums.h). That of the head
  // always counts, that of all once the recording is complete. To be called last: rows are known.
  void verify_checksums() const;

  // All values, finite. May throw CannotUnpack, but not in a trial.
  std::vector<double> read(const Set& set) const;

  // The same; in a trial none where HDF5 only has to find the chunks, not to unpack them.
  std::vector<double> read_unless_trial(const Set& set) const;

  // A dataset that has rows of its own, perhaps none.
  std::vector<double> read_table(const std::string& name, const char* unit, int width);

  // /time: read first, since a file can't claim rows that it doesn't hold and have them increase.
  std::vector<double> read_time();

  // Attributes of the root. The require_ ones refuse the file if they are missing.
  std::optional<std::string> text(const char* name) const;
  std::string require_text(const char* name) const;
  std::optional<double> number(const char* name) const;
  double require_number(const char* name) const;
  std::optional<std::vector<double>> numbers(const char* name, std::size_t count) const;

  // A row's values as what they stand for.
  Quat quaternion(const std::string& dataset, std::size_t row, const double* v) const;
  double whole_number(const std::string& dataset, std::size_t row, double value, double least,
                      double most) const;

 private:
  std::vector<double> values_of(const Set& set) const;
  std::optional<ChunkPlaces> chunk_places(const Set& set) const;
  void check_type(const Set& set) const;
  std::vector<std::uint64_t> extent(const Set& set) const;
  std::uint64_t check_shape(Set& set, const std::vector<std::uint64_t>& size,
                            bool per_tissue) const;
  void check_storage(const Set& set) const;
  void check_unit(const Set& set, const char* unit, bool required) const;
  std::vector<int> tissues_of(const Set& set) const;
  std::optional<std::string> text(Id object, const char* name, const std::string& owner) const;
  std::vector<std::string> strings(const Handle& attribute, const std::string& place,
                                   std::int64_t most) const;

  // Refuses a file that was cut off: rows that lie beyond its end.
  void check_end() const;

  bool has_attribute(const char* name) const;

  // What helps against damage: a recording can be recovered.
  std::string remedy() const;

  std::string path_;
  Unpacking unpacking_;
  bool trial_;
  Handle file_;
  bool growing_ = false, complete_ = false;
  bool shared_ = false;  // opened as SWMR readers do
  int descriptor_ = -1;  // HDF5's; none: only HDF5 knows where its bytes are
  std::optional<std::size_t> rows_;
  std::size_t proven_rows_ = 0;
};

// Of a damaged file's text, what can be shown in a line.
std::string printable(std::string text);

// Of all groups and datasets, as "/group/name".
std::vector<std::string> object_names(Id file);

// Of a dataset in chunks, how many of its rows lie within the first `bytes` of the file.
std::uint64_t rows_within(Id dataset, std::uint64_t bytes);

// Lets a child process parse the file; throws InputError if that fails.
void try_parsing(const std::string& path, Unpacking unpacking,
                 const std::function<void(Reader&)>& parse);

// Whether all of a file is looked at, checksums too, or just what tells its kind.
enum class Extent { kWhole, kGlance };

// parse(Reader&) for a file that may be damaged. HDF5 (1.10 at least) follows some damaged
// references blindly: it crashes, loops or takes gigabytes. So, unless the policy is kDirect, a
// child process parses the file first, and only what came through there is parsed here. The child
// may take half a second of CPU time for what is no data, and as much more for data as the rows need
// that were found so far (Reader::read). What HDF5 does here it has done there: where chunks lie is
// found in both, and if they can't be unpacked here, all begins anew with HDF5 unpacking them in both.
template <class Parse>
auto read_with_care(const std::string& path, ReadPolicy policy, Parse parse,
                    Extent extent = Extent::kWhole) {
  const auto lock = lock_hdf5();
  const Quiet quiet;
  const auto parse_and_verify = [&](Reader& in) {
    auto result = parse(in);
    if (extent == Extent::kWhole) in.verify_checksums();
    return result;
  };
  const auto read = [&](Unpacking unpacking) {
    if (policy == ReadPolicy::kTrial) try_parsing(path, unpacking, parse_and_verify);
    Reader in(path, unpacking);
    return policy == ReadPolicy::kTrial ? parse(in) : parse_and_verify(in);
  };
  try {
    return read(Unpacking::kHere);
  } catch (const CannotUnpack&) {
    return read(Unpacking::kByHdf5);
  }
}

}  // namespace toothprep::h5
