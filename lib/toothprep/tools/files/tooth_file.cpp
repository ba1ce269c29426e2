#include "toothprep/tools/files/tooth_file.h"

#include <fmt/format.h>
#include <openvdb/io/Archive.h>
#include <openvdb/io/Stream.h>
#include <openvdb/openvdb.h>
#include <tbb/parallel_for.h>
#include <tbb/partitioner.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <exception>
#include <limits>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <sstream>
#include <utility>
#include <vector>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/hash.h"
#include "toothprep/step/core/huge_pages.h"
#include "toothprep/tools/files/cut_way_text.h"
#include "toothprep/tools/io/large_file.h"
#include "toothprep/tools/io/trial.h"
#include "toothprep/tools/io/write_file.h"

namespace toothprep {
namespace {

using openvdb::FloatGrid;
using openvdb::Int32Grid;

constexpr const char* kToothSchema = "toothprep-tooth";
constexpr int kToothSchemaVersion = 1;
constexpr const char* kSchemaKey = "toothprep_schema";
constexpr const char* kVersionKey = "toothprep_schema_version";
constexpr const char* kVoxelKey = "voxel_mm";
constexpr const char* kHashKey = "tooth_sha256";
constexpr const char* kBodiesKey = "bodies";  // the list: "36:tooth,37:neighbour"
constexpr const char* kBodyGrid = "body";
constexpr const char* kVolumePrefix = "volume_mm3_";
constexpr const char* kWayGrid = "cut_by";  // of a tooth that was cut here: which part cut deepest
constexpr const char* kWayKey = "bur_way";  // and the parts of the bur's way, on that grid
constexpr std::array<const char*, 9> kLevelSetNames = {
    "solid", "enamel",        "dentin",        "pulp",       "intact",
    "cut",   "intact_enamel", "intact_dentin", "intact_pulp"};
constexpr int kAlways = 4;   // of them in every tooth; the others in one that was cut here,
constexpr int kTissues = 6;  // of which the last three may be missing
constexpr int kDentin = 2;

constexpr std::uint64_t kMostBytes = std::uint64_t{1} << 33;  // of a file
constexpr double kFarthest = 1e4;                             // mm, of a tooth from the origin
constexpr double kLargest = 300;                              // mm

// What trying to read a file may take; a tooth takes some 10 bytes for one of its file, uniform
// ones up to 60, and 10 ns.
constexpr std::size_t kTrialMemory = std::size_t{3} << 28, kTrialMemoryPerByte = 60;
constexpr double kTrialSeconds = 0.5, kTrialSecondsPerByte = 1e-7;  // CPU

// How far the solid of a file may be from what its parts make of it, in voxels: half floats carry
// 11 bits of three voxels.
constexpr float kMostMismatch = 0.01F;

// work(grid) for the level set of a name; the last five only of a tooth that has them.
template <class Tooth, class Work>
void with_level_set(Tooth& tooth, int k, const Work& work) {
  if (k == 0)
    work(tooth.solid);
  else if (k < kAlways)
    work(tooth.remains[static_cast<std::size_t>(k - 1)]);
  else if (k < kTissues)
    work(k == kAlways ? tooth.parts->intact : tooth.parts->cut);
  else
    work((*tooth.parts->tissues)[static_cast<std::size_t>(k - kTissues)]);
}
int level_sets_of(const LayeredTooth& tooth) {
  if (!tooth.parts) return kAlways;
  return tooth.parts->tissues ? static_cast<int>(kLevelSetNames.size()) : kTissues;
}

std::string text_of(double value) { return fmt::format("{:.9g}", value); }

// ---- The archive's id. OpenVDB puts a random UUID (version 4) at a fixed place of the header.
// Ours is of version 8 (RFC 9562: free to derive) and holds 122 bits of the SHA-256 over the file
// with the id blanked out. So equal teeth make equal files, and a damaged file is known before
// OpenVDB, whose reader trusts the counts that it finds, gets to parse it.

constexpr std::size_t kIdOffset = 21;  // magic 8, file version 4, library version 8, offsets flag 1
constexpr std::size_t kIdLength = 36;
constexpr std::size_t kIdVersionDigit = 14;

bool looks_like_uuid(const char* text) {
  for (std::size_t i = 0; i < kIdLength; ++i) {
    const bool dash = i == 8 || i == 13 || i == 18 || i == 23;
    if (dash ? text[i] != '-' : !std::isxdigit(static_cast<unsigned char>(text[i]))) return false;
  }
  return true;
}

// The beginning of a file, with the id blanked out.
void hash_head(Sha256& hash, std::span<const char> head) {
  const std::string blank(kIdLength, '0');
  hash.update(head.data(), kIdOffset);
  hash.update(blank.data(), blank.size());
  hash.update(head.data() + kIdOffset + kIdLength, head.size() - kIdOffset - kIdLength);
}

std::string id_of_content(Sha256& hash) {
  std::string id = hash.hex().substr(0, 32);
  id[12] = '8';
  id[16] = '8';
  for (const std::size_t dash : {8, 13, 18, 23}) id.insert(dash, "-");
  return id;
}

// ---- Writing

openvdb::math::Transform::Ptr transform_of(const Lattice& lattice) {
  auto transform = openvdb::math::Transform::createLinearTransform(lattice.voxel);
  transform->postTranslate(
      openvdb::Vec3d(lattice.origin.x(), lattice.origin.y(), lattice.origin.z()));
  return transform;
}

constexpr auto kEveryBrick = [](std::size_t) { return true; };

// Copies bricks to leaves (same layout); uniform bricks become tiles. `is_active` says which voxels
// are, `is_wanted` which bricks.
template <class Grid, class Bricks, class IsActive, class IsWanted = decltype(kEveryBrick)>
void fill_tree(Grid& grid, const Bricks& bricks, IsActive is_active,
               IsWanted is_wanted = kEveryBrick) {
  using Leaf = typename Grid::TreeType::LeafNodeType;
  using T = decltype(bricks.background());
  std::array<T, kBrickVoxels> unpacked;
  openvdb::tree::ValueAccessor<typename Grid::TreeType> tree(grid.tree());
  for (std::size_t b = 0; b < bricks.table_size(); ++b) {
    if (bricks.is_uniform(b) && bricks.uniform_value(b) == bricks.background()) continue;
    if (!is_wanted(b)) continue;
    const Index3 first = bricks.brick_origin(b);
    const openvdb::Coord origin(first.x(), first.y(), first.z());
    const T* values = brick_values(bricks, b, unpacked);
    const bool uniform = bricks.is_uniform(b) || std::all_of(values, values + kBrickVoxels,
                                                             [&](T v) { return v == values[0]; });
    if (uniform) {
      if (values[0] != bricks.background())
        tree.addTile(1, origin, static_cast<typename Grid::ValueType>(values[0]),
                     is_active(values[0]));
      continue;
    }
    Leaf* leaf = tree.touchLeaf(origin);
    std::copy(values, values + kBrickVoxels, leaf->buffer().data());
    auto mask = leaf->getValueMask();
    for (openvdb::Index word = 0; word < 8; ++word) {
      openvdb::Index64 bits = 0;
      for (int v = 0; v < 64; ++v)
        bits |= static_cast<openvdb::Index64>(is_active(values[word * 64 + v])) << v;
      mask.template getWord<openvdb::Index64>(word) = bits;
    }
    leaf->setValueMask(mask);
  }
  grid.tree().prune();
}

template <class Grid>
void describe(Grid& grid, const char* name, const LayeredTooth& tooth) {
  grid.setName(name);
  grid.setTransform(transform_of(tooth.lattice));
  grid.insertMeta(kSchemaKey, openvdb::StringMetadata(kToothSchema));
  grid.insertMeta(kVersionKey, openvdb::Int32Metadata(kToothSchemaVersion));
  grid.insertMeta(kVoxelKey, openvdb::DoubleMetadata(tooth.lattice.voxel));
}

openvdb::MetaMap file_metadata(const LayeredTooth& tooth) {
  openvdb::MetaMap meta;
  for (const auto& [key, value] : tooth.provenance)
    if (!key.empty()) meta.insertMeta(key, openvdb::StringMetadata(value));
  const auto put = [&meta](const std::string& key, const openvdb::Metadata& value) {
    meta.removeMeta(key);  // a provenance key of the same name but another type would throw
    meta.insertMeta(key, value);
  };
  put(kSchemaKey, openvdb::StringMetadata(kToothSchema));
  put(kVersionKey, openvdb::Int32Metadata(kToothSchemaVersion));
  put(kVoxelKey, openvdb::DoubleMetadata(tooth.lattice.voxel));
  put(kHashKey, openvdb::StringMetadata(tooth_sha256(tooth)));
  if (tooth.bodies) put(kBodiesKey, openvdb::StringMetadata(bodies_text(tooth.bodies->list)));
  const PerTissue<double> volumes = remaining_volumes_mm3(tooth);
  for (int k = 0; k < kTissueCount; ++k)
    put(kVolumePrefix + std::string(kTissueNames[k]), openvdb::DoubleMetadata(volumes[k]));
  return meta;
}

// Whose each voxel with a tissue is. (In memory the air beside is of the nearest body, too.)
Int32Grid::Ptr body_grid(const LayeredTooth& tooth) {
  auto grid = Int32Grid::create(0);
  if (!tooth.bodies) return grid;
  LabelGrid solid_only = make_body_grid(tooth.tissue, tooth.bodies->list.size());
  std::array<std::uint8_t, kBrickVoxels> values;
  for (std::size_t b = 0; b < solid_only.table_size(); ++b) {
    const std::uint8_t *body = tooth.bodies->of.brick(b), *tissue = tooth.tissue.brick(b);
    for (int v = 0; v < kBrickVoxels; ++v) values[v] = tissue[v] == 0 ? std::uint8_t{0} : body[v];
    solid_only.set_brick(b, values.data());
  }
  fill_tree(*grid, solid_only, [](std::uint8_t v) { return v != 0; });
  return grid;
}

// Which part of the bur's way cut deepest at each voxel, with the parts.
Int32Grid::Ptr way_grid(const LayeredTooth& tooth) {
  auto grid = Int32Grid::create(0);
  if (!tooth.parts || !tooth.parts->way) return grid;
  fill_tree(*grid, tooth.parts->way->deepest, [](float number) { return number != 0; });
  describe(*grid, kWayGrid, tooth);
  grid->insertMeta(kWayKey, openvdb::StringMetadata(cut_way_text(*tooth.parts->way)));
  return grid;
}

// Whether what remains of a tissue isn't the intact one's there: only then a file has that.
bool has_changed(const LayeredTooth& tooth, int tissue, std::size_t brick) {
  const auto k = static_cast<std::size_t>(tissue);
  const PackedLevelSet &intact = (*tooth.parts->tissues)[k], &remains = tooth.remains[k];
  if (intact.same_brick(brick, remains)) return false;
  std::array<float, kBrickVoxels> before, now;
  intact.brick(brick).unpack(before.data());
  remains.brick(brick).unpack(now.data());
  return before != now;
}

// The archive goes to memory first: its id is derived from its bytes, and openvdb::io::File would
// not report a full disk.
class MemoryArchive : public openvdb::io::Archive {
 public:
  MemoryArchive() {
    setCompression(openvdb::io::COMPRESS_BLOSC | openvdb::io::COMPRESS_ACTIVE_MASK);
  }
  std::string bytes(const openvdb::GridCPtrVec& grids, const openvdb::MetaMap& meta) const {
    std::ostringstream memory;
    Archive::write(memory, grids, /*seekable=*/true, meta);  // seekable: with the grids' offsets
    return std::move(memory).str();
  }
};

// The bytes of an archive of these grids, which are compressed side by side: each in an archive of
// its own, whose offsets, those of the grid, of its voxels and of its end, are then moved.
std::string archive_of(const openvdb::GridPtrVec& grids, const openvdb::MetaMap& meta) {
  std::vector<std::string> parts(grids.size());
  std::string whole;
  tbb::parallel_for(std::size_t{0}, grids.size() + 1, [&](std::size_t n) {
    if (n == grids.size())
      whole = MemoryArchive().bytes({}, meta);
    else
      parts[n] = MemoryArchive().bytes({grids[n]}, {});
  });
  const std::size_t head = MemoryArchive().bytes({}, {}).size();
  const auto count = static_cast<std::int32_t>(grids.size());
  std::memcpy(&whole[whole.size() - sizeof count], &count, sizeof count);
  std::size_t size = whole.size();
  for (const std::string& part : parts) size += part.size() - head;
  whole.reserve(size);
  for (std::size_t n = 0; n < parts.size(); ++n) {
    // Before the offsets stand three texts: the grid's name and type, and that of no other grid.
    std::size_t at = head;
    for (int text = 0; text < 3; ++text) {
      std::uint32_t length = 0;
      std::memcpy(&length, &parts[n][at], sizeof length);
      at += sizeof length + length;
    }
    for (int k = 0; k < 3; ++k, at += sizeof(std::int64_t)) {
      std::int64_t offset = 0;
      std::memcpy(&offset, &parts[n][at], sizeof offset);
      offset += static_cast<std::int64_t>(whole.size()) - static_cast<std::int64_t>(head);
      std::memcpy(&parts[n][at], &offset, sizeof offset);
    }
    whole.append(parts[n], head);
    std::string().swap(parts[n]);
  }
  return whole;
}

// ---- Reading

[[noreturn]] void refuse_grid(const std::string& path, const std::string& grid,
                              const std::string& condition, const std::string& remedy = {}) {
  throw InputError(path, "grid '" + grid + "'", condition, remedy);
}

// The archive in memory as a stream that throws at its end instead of handing out garbage.
class ByteStream : public std::istream {
 public:
  explicit ByteStream(std::span<char> bytes) : std::istream(nullptr), buffer_(bytes) {
    rdbuf(&buffer_);
    exceptions(std::ios::badbit | std::ios::failbit);
  }

 private:
  struct Buffer : std::streambuf {
    explicit Buffer(std::span<char> bytes) {
      setg(bytes.data(), bytes.data(), bytes.data() + bytes.size());
    }
    pos_type seekoff(off_type offset, std::ios_base::seekdir way,
                     std::ios_base::openmode) override {
      const off_type base = way == std::ios_base::beg   ? 0
                            : way == std::ios_base::cur ? gptr() - eback()
                                                        : egptr() - eback();
      if (base + offset < 0 || base + offset > egptr() - eback()) return pos_type(off_type(-1));
      setg(eback(), eback() + base + offset, egptr());
      return pos_type(base + offset);
    }
    pos_type seekpos(pos_type position, std::ios_base::openmode mode) override {
      return seekoff(off_type(position), std::ios_base::beg, mode);
    }
  };
  Buffer buffer_;
};

// A stream over a file's bytes: reads the grids' trees, and then the voxels of one grid's leaves.
class ArchiveReader : public openvdb::io::Archive {
 public:
  explicit ArchiveReader(std::span<char> bytes) : stream_(bytes) {
    openvdb::io::setStreamMetadataPtr(stream_, stream_meta_, /*transfer=*/false);
    readHeader(stream_);
    setFormatVersion(stream_);
    setLibraryVersion(stream_);
    setDataCompression(stream_);
    meta_->readMeta(stream_);
    count_ = readGridCount(stream_);
  }
  openvdb::MetaMap::Ptr meta() const { return meta_; }
  int count() const { return count_; }

  // Grid n with its tree, whose leaves have no values yet; once.
  openvdb::GridBase::Ptr read_tree(int n) {
    for (int g = 0;; ++g) {
      openvdb::io::GridDescriptor descriptor;
      openvdb::GridBase::Ptr grid = descriptor.read(stream_);
      if (g < n) {
        descriptor.seekToEnd(stream_);
        continue;
      }
      descriptor.seekToGrid(stream_);
      readGridCompression(stream_);
      grid->readMeta(stream_);
      grid->readTransform(stream_);
      grid->readTopology(stream_);
      descriptor.seekToBlocks(stream_);
      return grid;
    }
  }

  // The values of that grid's next leaf, which are not kept.
  template <class Leaf>
  void read_values(const Leaf& leaf, typename Leaf::ValueType* values) {
    auto mask = leaf.getValueMask();
    mask.load(stream_);
    openvdb::io::readCompressedValues(stream_, values, Leaf::SIZE, mask, /*fromHalf=*/false);
  }

 private:
  // The stream keeps this pointer's address.
  openvdb::io::StreamMetadata::Ptr stream_meta_ = std::make_shared<openvdb::io::StreamMetadata>();
  ByteStream stream_;
  openvdb::MetaMap::Ptr meta_ = std::make_shared<openvdb::MetaMap>();
  int count_ = 0;
};

struct Archive {
  openvdb::MetaMap::Ptr meta;
  openvdb::GridPtrVecPtr grids;
  // Of a file that write_tooth() wrote: what reads the values of each grid's leaves.
  std::vector<std::unique_ptr<ArchiveReader>> readers;
};

constexpr const char* kDamaged = "is damaged or truncated";
constexpr const char* kAgain = "make or copy the file again";

// The bytes of an OpenVDB file that this library reads, and whether they are those that
// write_tooth() wrote.
struct Content {
  FileBytes file;
  bool ours = false;
};

// Looks at the first piece, and takes the checksum of our own files.
class ContentCheck {
 public:
  explicit ContentCheck(const std::string& path) : path_(path) {}

  void take(std::span<const char> piece) {
    if (!begun_)
      begin(piece);
    else if (ours_)
      hash_.update(piece.data(), piece.size());
  }
  bool ours() const { return ours_; }
  // Once there is no further piece.
  void finish() {
    if (!begun_) throw InputError(path_, "", "is empty", "give a tooth file (.vdb)");
    if (ours_ && id_ != id_of_content(hash_))
      throw InputError(path_, "", std::string(kDamaged) + " (its checksum does not match)", kAgain);
  }

 private:
  void begin(std::span<const char> head) {
    static constexpr std::array<char, 8> kMagic = {' ', 'B', 'D', 'V', 0, 0, 0, 0};
    if (head.size() < kMagic.size() || !std::equal(kMagic.begin(), kMagic.end(), head.begin()))
      throw InputError(path_, "", "is not an OpenVDB file",
                       "give a tooth file (.vdb), as voxelize and specimen write them");
    if (head.size() < kIdOffset + kIdLength) throw InputError(path_, "", kDamaged, kAgain);
    id_ = std::string(head.data() + kIdOffset, kIdLength);
    ours_ = looks_like_uuid(id_.data()) && id_[kIdVersionDigit] == '8';
    if (ours_) hash_head(hash_, head);
    begun_ = true;
  }

  const std::string& path_;
  Sha256 hash_;
  std::string id_;
  bool begun_ = false, ours_ = false;
};

Content content_of(const std::string& path) {
  ContentCheck check(path);
  Content content{
      large_file(path, kMostBytes, [&](std::span<const char> piece) { check.take(piece); })};
  check.finish();
  content.ours = check.ours();
  const std::span<char> bytes = content.file.all();
  std::uint32_t version = 0;
  std::memcpy(&version, bytes.data() + 8, sizeof version);
  if (version > openvdb::OPENVDB_FILE_VERSION)
    throw InputError(path, "",
                     "is of OpenVDB's file version " + std::to_string(version) +
                         ", newer than this program's " +
                         std::to_string(openvdb::OPENVDB_FILE_VERSION),
                     "save it with an older OpenVDB");
  return content;
}

Archive parse(const std::string& path, std::span<char> bytes) {
  try {
    ByteStream stream(bytes);
    const openvdb::io::Stream archive(stream, /*delayLoad=*/false);
    Archive result{archive.getMetadata(), const_cast<openvdb::io::Stream&>(archive).getGrids(), {}};
    if (!result.meta || !result.grids) throw InputError(path, "", kDamaged, kAgain);
    return result;
  } catch (const InputError&) {
    throw;
  } catch (const std::ios_base::failure&) {
    throw InputError(path, "", kDamaged, kAgain);
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& e) {
    throw InputError(path, "", std::string("cannot be read by OpenVDB (") + e.what() + ")",
                     "the file may be damaged or hold grids of an unknown type");
  }
}

// work(n) for 0 .. count - 1, side by side where that is allowed. What the first that fails throws
// is thrown.
template <class Work>
void for_each_grid(int count, bool parallel, const Work& work) {
  std::vector<std::exception_ptr> failures(static_cast<std::size_t>(count));
  const auto guarded = [&](int n) {
    try {
      work(n);
    } catch (...) {
      failures[static_cast<std::size_t>(n)] = std::current_exception();
    }
  };
  if (parallel)
    tbb::parallel_for(0, count, guarded, tbb::simple_partitioner());
  else
    for (int n = 0; n < count; ++n) guarded(n);
  for (const std::exception_ptr& failure : failures)
    if (failure) std::rethrow_exception(failure);
}

// Of a file that write_tooth() wrote: the grids side by side, without the values of leaves, which go
// from the file to bricks one by one.
Archive parse_ours(const std::string& path, std::span<char> bytes) {
  try {
    const ArchiveReader reader(bytes);
    Archive result{reader.meta(), std::make_shared<openvdb::GridPtrVec>(), {}};
    const auto count = static_cast<std::size_t>(std::max(0, reader.count()));
    result.grids->resize(count);
    result.readers.resize(count);
    for_each_grid(reader.count(), /*parallel=*/true, [&](int n) {
      auto& own = result.readers[static_cast<std::size_t>(n)];
      own = std::make_unique<ArchiveReader>(bytes);
      (*result.grids)[static_cast<std::size_t>(n)] = own->read_tree(n);
    });
    return result;
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& e) {
    throw InputError(path, "", std::string("cannot be read by OpenVDB (") + e.what() + ")", kAgain);
  }
}

std::optional<std::string> find_text(const openvdb::MetaMap& meta, const std::string& key) {
  const auto value = meta[key];
  if (!value) return std::nullopt;
  return value->str();
}

void check_schema(const std::string& path, const Archive& archive) {
  // Programs that rewrite a .vdb tend to keep the grids' metadata and drop the file's.
  std::vector<const openvdb::MetaMap*> places{archive.meta.get()};
  for (const auto& grid : *archive.grids)
    if (grid) places.push_back(grid.get());
  for (const openvdb::MetaMap* meta : places) {
    const auto schema = find_text(*meta, kSchemaKey);
    if (!schema) continue;
    if (*schema != kToothSchema)
      throw InputError(path, kSchemaKey, "is '" + *schema + "' instead of '" + kToothSchema + "'",
                       "give a tooth file");
    const auto version = find_text(*meta, kVersionKey);
    if (version != std::to_string(kToothSchemaVersion))
      throw InputError(path, kVersionKey,
                       "is " + version.value_or("absent") + "; this program reads version " +
                           std::to_string(kToothSchemaVersion));
    return;
  }
  throw InputError(path, kSchemaKey, "is absent, so this is not a tooth file",
                   "make one with 'toothprep voxelize' or 'toothprep specimen'");
}

bool has_grid(const Archive& archive, const std::string& name) {
  return std::any_of(archive.grids->begin(), archive.grids->end(),
                     [&](const auto& grid) { return grid && grid->getName() == name; });
}

template <class Grid>
typename Grid::Ptr find_grid(const std::string& path, const Archive& archive,
                             const std::string& name, const char* wanted) {
  for (const auto& grid : *archive.grids) {
    if (!grid || grid->getName() != name) continue;
    if (auto typed = openvdb::gridPtrCast<Grid>(grid)) return typed;
    refuse_grid(path, name, "holds " + grid->valueType() + " values instead of " + wanted);
  }
  refuse_grid(path, name, "is missing", "a tooth file has tissue, solid, enamel, dentin and pulp");
}

Lattice lattice_of(const std::string& path, const std::string& name,
                   const openvdb::GridBase& grid) {
  if (!grid.transform().isLinear()) refuse_grid(path, name, "its transform is not linear");
  const openvdb::Mat4d m = grid.transform().baseMap()->getAffineMap()->getMat4();
  Lattice lattice;
  lattice.voxel = m(0, 0);
  lattice.origin = Vec3(m(3, 0), m(3, 1), m(3, 2));
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j)
      if (!std::isfinite(m(i, j))) refuse_grid(path, name, "its transform is not finite");
  if (!(lattice.voxel > 0 && lattice.voxel <= 10))
    refuse_grid(path, name, "its voxel size is " + text_of(lattice.voxel) + " mm",
                "it must lie in (0, 10] mm");
  const double slack = 1e-6 * lattice.voxel;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      if (std::abs(m(i, j) - (i == j ? lattice.voxel : 0)) > slack)
        refuse_grid(path, name,
                    "its transform is rotated, sheared or has voxels that are not cubes",
                    "resample it to cubic voxels along the axes");
  return lattice;
}

// The box of everything that differs from the background: active voxels and inside tiles.
template <class Grid>
openvdb::CoordBBox extent_of(const Grid& grid) {
  openvdb::CoordBBox box;
  grid.tree().evalActiveVoxelBoundingBox(box);
  auto tile = grid.tree().cbeginValueOff();
  tile.setMaxDepth(decltype(tile)::LEAF_DEPTH - 1);
  for (; tile; ++tile)
    if (*tile != grid.background()) box.expand(tile.getBoundingBox());
  return box;
}

// The values of a grid's leaves one after the other: from the leaves, or straight from the file.
template <class Grid>
class LeafValues {
 public:
  using Leaf = typename Grid::TreeType::LeafNodeType;
  LeafValues(const std::string& path, const Archive& archive, const Grid& grid) : path_(path) {
    for (std::size_t n = 0; n < archive.readers.size(); ++n)
      if ((*archive.grids)[n].get() == &grid) reader_ = archive.readers[n].get();
  }
  const typename Grid::ValueType* of(const Leaf& leaf) {
    if (!reader_) return leaf.buffer().data();
    try {
      reader_->read_values(leaf, values_.data());
    } catch (const std::ios_base::failure&) {
      throw InputError(path_, "", kDamaged, kAgain);
    }
    return values_.data();
  }

 private:
  const std::string& path_;
  ArchiveReader* reader_ = nullptr;
  std::array<typename Grid::ValueType, kBrickVoxels> values_;
};

// Reserves `count` bricks on huge pages, in a grid that holds its background alone: brick 0 is then
// the start of the grid's storage.
template <class T>
void reserve_to_fill(BrickGrid<T>& bricks, std::size_t count) {
  bricks.reserve(count);
  if (bricks.table_size() == 0 || !bricks.is_uniform(0) || bricks.is_shared(0)) return;
  advise_huge_pages(bricks.brick(0), sizeof(T) * kBrickVoxels * bricks.bricks_free());
}

// Copies leaves and tiles to bricks, and empties the grid. `convert` checks and translates the 512
// values of a leaf, `convert_tile` a tile's; `store` puts what they are into a brick.
template <class Grid, class Bricks, class Convert, class ConvertTile, class Store>
void fill_bricks(Bricks& bricks, LeafValues<Grid> leaves, Grid& grid, Convert convert,
                 ConvertTile convert_tile, Store store) {
  using T = decltype(bricks.background());
  std::array<T, kBrickVoxels> values;
  if constexpr (requires { bricks.reserve(1); }) reserve_to_fill(bricks, grid.tree().leafCount());
  for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf) {
    const auto* stored = leaves.of(*leaf);
    const openvdb::Coord at = leaf->origin();
    const std::int64_t place = bricks.brick_index(at.x(), at.y(), at.z());
    if (place < 0) continue;  // nothing in it that counts, else the box would hold it
    const auto brick = static_cast<std::size_t>(place);
    convert(stored, values.data());
    store(brick, values.data());
  }
  auto tile = grid.tree().cbeginValueAll();
  tile.setMaxDepth(decltype(tile)::LEAF_DEPTH - 1);
  const Index3 first = bricks.first_brick() * kBrickEdge,
               last = first + bricks.brick_counts() * kBrickEdge - Index3::Ones();
  for (; tile; ++tile) {
    if (*tile == grid.background()) continue;
    const T value = convert_tile(*tile);
    openvdb::CoordBBox box = tile.getBoundingBox();
    box.intersect({{first.x(), first.y(), first.z()}, {last.x(), last.y(), last.z()}});
    for (int x = box.min().x(); x <= box.max().x(); x += kBrickEdge)
      for (int y = box.min().y(); y <= box.max().y(); y += kBrickEdge)
        for (int z = box.min().z(); z <= box.max().z(); z += kBrickEdge)
          bricks.set_uniform(static_cast<std::size_t>(bricks.brick_index(x, y, z)), value);
  }
  grid.newTree();
}

// Distances of a file in a level set's: what is saturated there is far away, whatever band the
// file's writer used. By their bits, whose order is that of the sizes, so that the compiler makes
// vector instructions of it.
class Distances {
 public:
  Distances(const std::string& path, int k, float width, float band)
      : path_(path),
        k_(static_cast<std::size_t>(k)),
        band_(band),
        limit_(bits_of(std::min(width, band))),
        band_bits_(bits_of(band)) {}

  void convert(const float* source, float* target) const {
    std::int32_t most = 0;
    std::array<std::int32_t, kBrickVoxels> bits;
    std::memcpy(bits.data(), source, sizeof bits);
    for (std::int32_t& v : bits) {
      most = std::max(most, v & INT32_MAX);
      v = (v & INT32_MAX) >= limit_ ? (v & INT32_MIN) | band_bits_ : v;
    }
    std::memcpy(target, bits.data(), sizeof bits);
    if (most >= bits_of(std::numeric_limits<float>::infinity())) refuse_infinite();
  }
  float tile(float v) const {
    if (!std::isfinite(v)) refuse_infinite();
    // A tile spans 512 voxels or more, so it cannot be in a narrow band.
    if (bits_of(std::abs(v)) < limit_)
      refuse_grid(path_, kLevelSetNames[k_],
                  "holds a tile of " + text_of(v) + " mm, which lies inside the narrow band");
    return std::copysign(band_, v);
  }

 private:
  static std::int32_t bits_of(float v) {
    std::int32_t bits = 0;
    std::memcpy(&bits, &v, sizeof bits);
    return bits;
  }
  [[noreturn]] void refuse_infinite() const {
    refuse_grid(path_, kLevelSetNames[k_], "holds a value that is not a finite number");
  }

  const std::string& path_;
  std::size_t k_;
  float band_;
  std::int32_t limit_, band_bits_;
};

// Those of kLevelSetNames that the file has.
std::vector<FloatGrid::Ptr> find_level_sets(const std::string& path, const Archive& archive) {
  const bool intact = has_grid(archive, "intact"), cut = has_grid(archive, "cut");
  if (intact != cut)
    refuse_grid(path, intact ? "cut" : "intact",
                std::string("is missing, though there is '") + (intact ? "intact'" : "cut'"),
                "a prepared tooth has both; delete the other to go by 'solid' alone");
  std::size_t count = cut ? kTissues : kAlways, tissues = 0;
  for (std::size_t k = kTissues; k < kLevelSetNames.size(); ++k)
    tissues += has_grid(archive, kLevelSetNames[k]) ? 1 : 0;
  if (tissues != 0) {
    if (!cut || count + tissues != kLevelSetNames.size())
      throw InputError(path, "",
                       "has some of the grids 'intact_enamel', 'intact_dentin' and 'intact_pulp', "
                       "but not all of them with 'intact' and 'cut'",
                       "delete them to go by what remains of the tissues");
    count = kLevelSetNames.size();
  }
  std::vector<FloatGrid::Ptr> found;
  for (std::size_t k = 0; k < count; ++k)
    found.push_back(find_grid<FloatGrid>(path, archive, kLevelSetNames[k], "float"));
  return found;
}

// Refuses a level set that isn't one in mm, on the lattice of the others.
void check_level_set(const std::string& path, const std::string& name, const FloatGrid& grid,
                     const Lattice& lattice) {
  const Lattice own = lattice_of(path, name, grid);
  if (std::abs(own.voxel - lattice.voxel) > 1e-6 * lattice.voxel ||
      (own.origin - lattice.origin).cwiseAbs().maxCoeff() > 1e-4 * lattice.voxel)
    refuse_grid(path, name, "lies on another lattice than the grid 'tissue'",
                "resample all grids to one transform");
  const double width = grid.background() / lattice.voxel;
  if (!(width >= 1 && width <= 20))
    refuse_grid(path, name,
                "is not a narrow-band level set in mm (background " + text_of(grid.background()) +
                    " at a voxel size of " + text_of(lattice.voxel) + " mm)",
                "distances in mm, negative inside, with a band of about 3 voxels are expected");
}

// What was cut out of the intact tooth is the solid that the file has.
void check_parts(const std::string& path, const LayeredTooth& tooth) {
  if (!tooth.parts) return;
  const ToothParts& parts = *tooth.parts;
  const auto voxel = static_cast<float>(tooth.lattice.voxel);
  for (std::size_t b = 0; b < tooth.solid.table_size(); ++b) {
    const float *solid = tooth.solid.brick(b), *intact = parts.intact.brick(b),
                *cut = parts.cut.brick(b);
    const bool uniform =
        tooth.solid.is_uniform(b) && parts.intact.is_uniform(b) && parts.cut.is_uniform(b);
    for (int v = 0; v < (uniform ? 1 : kBrickVoxels); ++v) {
      const float off = std::abs(solid[v] - std::max(intact[v], -cut[v]));
      if (off <= kMostMismatch * voxel) continue;
      const Index3 i = tooth.solid.brick_origin(b) + Index3(v >> 6, (v >> 3) & 7, v & 7);
      refuse_grid(path, "solid",
                  fmt::format("is not what 'cut' leaves of 'intact': {:.4g} mm off at the voxel "
                              "{}, {}, {}",
                              off, i.x(), i.y(), i.z()),
                  "delete 'intact' and 'cut' to go by 'solid' alone");
    }
  }
}

// What grinding left of the intact tissues is what the file has of them.
void check_intact_tissue(const std::string& path, const LayeredTooth& tooth, std::size_t k) {
  if (!tooth.parts || !tooth.parts->tissues) return;
  const PackedLevelSet &intact = (*tooth.parts->tissues)[k], &remains = tooth.remains[k];
  const float most = kMostMismatch * static_cast<float>(tooth.lattice.voxel);
  std::array<float, kBrickVoxels> before, now;
  for (std::size_t b = 0; b < remains.table_size(); ++b) {
    if (intact.same_brick(b, remains)) continue;
    intact.brick(b).unpack(before.data());
    remains.brick(b).unpack(now.data());
    const float* solid = tooth.solid.brick(b);
    for (int v = 0; v < kBrickVoxels; ++v)
      if (now[v] != before[v] && !(std::abs(now[v] - std::max(before[v], solid[v])) <= most))
        refuse_grid(path, kLevelSetNames[k + kTissues],
                    std::string("is at odds with '") + kLevelSetNames[k + 1] + "' and 'solid'",
                    "delete 'intact_enamel', 'intact_dentin' and 'intact_pulp' to go by what "
                    "remains of the tissues");
  }
}

// A grid of whole numbers from 0 to `most` on the tooth's lattice, into bricks.
template <class T>
void read_numbers(const std::string& path, const Archive& archive, const LayeredTooth& tooth,
                  const char* name, std::size_t most, BrickGrid<T>& to) {
  const Int32Grid::Ptr grid = find_grid<Int32Grid>(path, archive, name, "int32");
  const Lattice own = lattice_of(path, name, *grid);
  if (!(std::abs(own.voxel - tooth.lattice.voxel) <= 1e-6 * own.voxel &&
        (own.origin - tooth.lattice.origin).cwiseAbs().maxCoeff() <= 1e-4 * own.voxel))
    refuse_grid(path, name, "lies on another lattice than the grid 'tissue'",
                "resample all grids to one transform");
  const auto number = [&](openvdb::Int32 v) {
    if (v < 0 || static_cast<std::size_t>(v) > most)
      refuse_grid(path, name,
                  "holds the number " + std::to_string(v) + ", but its list has " +
                      std::to_string(most) + " entries");
    return static_cast<T>(v);
  };
  const auto numbers = [&](const openvdb::Int32* source, T* target) {
    for (int v = 0; v < kBrickVoxels; ++v) target[v] = number(source[v]);
  };
  fill_bricks(to, LeafValues(path, archive, *grid), *grid, numbers, number,
              [&](std::size_t b, const T* values) { to.set_brick(b, values); });
}

// The bur's way, of a file that has it.
void read_way(const std::string& path, const Archive& archive, LayeredTooth& tooth) {
  if (!has_grid(archive, kWayGrid)) return;
  constexpr const char* kRemedy = "delete the grid 'cut_by' to go by the cut alone";
  if (!tooth.parts) refuse_grid(path, kWayGrid, "is there without 'intact' and 'cut'", kRemedy);
  const auto text = find_text(*find_grid<Int32Grid>(path, archive, kWayGrid, "int32"), kWayKey);
  if (!text) refuse_grid(path, kWayGrid, "has no metadata 'bur_way'", kRemedy);
  try {
    CutWay way = parse_cut_way(*text);
    way.deepest = BrickGrid<float>(tooth.solid.first_brick(), tooth.solid.brick_counts(), 0, {0});
    read_numbers(path, archive, tooth, kWayGrid, way.parts.size(), way.deepest);
    tooth.parts->way = std::move(way);
  } catch (const InputError&) {
    throw;
  } catch (const Error& e) {
    throw InputError(path, kWayKey, e.what(), kRemedy);
  }
}

// The list of bodies and whose each voxel is, of a file that has both.
void read_bodies(const std::string& path, const Archive& archive, LayeredTooth& tooth) {
  if (!has_grid(archive, kBodyGrid)) return;
  auto text = find_text(*archive.meta, kBodiesKey);
  for (const auto& grid : *archive.grids)
    if (!text && grid) text = find_text(*grid, kBodiesKey);
  if (!text)
    throw InputError(path, kBodiesKey, "is absent, though there is a grid 'body'",
                     "delete the grid, or name the bodies: \"36:tooth,37:neighbour\"");
  try {
    std::vector<Body> list = parse_bodies(*text);
    LabelGrid of = make_body_grid(tooth.tissue, list.size());
    read_numbers(path, archive, tooth, kBodyGrid, list.size(), of);
    set_bodies(tooth, std::move(list), std::move(of));
  } catch (const InputError&) {
    throw;
  } catch (const Error& e) {
    throw InputError(path, kBodiesKey, e.what(),
                     "give every voxel with a tissue a body of the list");
  }
}

// Bricks that others have already are shared.
void store_level_set(LayeredTooth& tooth, int k, LevelSet& bricks, std::size_t b,
                     const float* values) {
  if (k > 0 && std::memcmp(tooth.solid.brick(b), values, sizeof(float) * kBrickVoxels) == 0 &&
      bricks.share_brick(b, tooth.solid))
    return;
  bricks.set_brick(b, values);
}
void store_level_set(LayeredTooth& tooth, int k, PackedLevelSet& bricks, std::size_t b,
                     const float* values) {
  if (k >= kTissues) {  // a copy of what remains, of which the file has what differs
    std::array<float, kBrickVoxels> now;
    bricks.brick(b).unpack(now.data());
    if (std::memcmp(now.data(), values, sizeof now) != 0) bricks.set_brick(b, values);
    return;
  }
  set_remains(tooth, static_cast<std::size_t>(k - 1), b, values);
}

// Empties the archive's grids. `parallel`: not in a child process, which has no other threads.
LayeredTooth tooth_of(const std::string& path, const Archive& archive, bool parallel) {
  check_schema(path, archive);

  const Int32Grid::Ptr tissue = find_grid<Int32Grid>(path, archive, "tissue", "int32");
  const std::vector<FloatGrid::Ptr> level_sets = find_level_sets(path, archive);
  const Lattice lattice = lattice_of(path, "tissue", *tissue);
  openvdb::CoordBBox box = extent_of(*tissue);
  if (tissue->background() != 0)
    refuse_grid(path, "tissue", "its background is " + std::to_string(tissue->background()),
                "the background must be 0 (air)");
  if (box.empty()) refuse_grid(path, "tissue", "is empty: no voxel has a label");
  for (std::size_t k = 0; k < level_sets.size(); ++k) {
    check_level_set(path, kLevelSetNames[k], *level_sets[k], lattice);
    box.expand(extent_of(*level_sets[k]));
  }
  // Judged in double before anything is allocated: a damaged or hostile file can claim any size.
  const openvdb::Vec3d bricks = (box.max().asVec3d() - box.min().asVec3d()) / kBrickEdge + 3.0;
  if (bricks.product() * kBrickVoxels > 8.6e9)
    throw InputError(path, "",
                     "its grids span " + text_of(box.max().asVec3d()[0] - box.min().asVec3d()[0]) +
                         " x " + text_of(box.max().asVec3d()[1] - box.min().asVec3d()[1]) + " x " +
                         text_of(box.max().asVec3d()[2] - box.min().asVec3d()[2]) + " voxels",
                     "at most 2^33 voxels are read; crop the grids to one tooth");

  LayeredTooth tooth =
      make_empty_tooth(lattice, Index3(box.min().x(), box.min().y(), box.min().z()),
                       Index3(box.max().x(), box.max().y(), box.max().z()));
  const auto label = [&](openvdb::Int32 v) {
    if (v < 0 || v > kTissueCount)
      refuse_grid(path, "tissue", "holds the label " + std::to_string(v),
                  "labels are 0 air, 1 enamel, 2 dentin, 3 pulp, 4 other");
    return static_cast<std::uint8_t>(v);
  };
  const auto labels = [&](const openvdb::Int32* source, std::uint8_t* target) {
    for (int v = 0; v < kBrickVoxels; ++v) target[v] = label(source[v]);
  };
  if (level_sets.size() > kAlways) tooth.parts = ToothParts{tooth.solid, tooth.solid};  // all air
  const auto fill_level_set = [&](int k) {
    const Distances distances(path, k, level_sets[k]->background(),
                              static_cast<float>(tooth.band()));
    with_level_set(tooth, k, [&](auto& level_set) {
      fill_bricks(
          level_set, LeafValues(path, archive, *level_sets[k]), *level_sets[k],
          [&](const float* source, float* target) { distances.convert(source, target); },
          [&](float v) { return distances.tile(v); },
          [&](std::size_t b, const float* values) {
            store_level_set(tooth, k, level_set, b, values);
          });
    });
  };
  for_each_grid(2, parallel, [&](int job) {
    if (job == 0) return fill_level_set(0);
    fill_bricks(
        tooth.tissue, LeafValues(path, archive, *tissue), *tissue, labels, label,
        [&](std::size_t b, const std::uint8_t* values) { tooth.tissue.set_brick(b, values); });
  });
  // Half of the tissues' bricks are the solid's, and nearly all of an intact solid's; most of the
  // others of enamel and pulp are the negative of dentin's.
  tooth.solid.freeze();
  tooth.tissue.freeze();
  const auto fill = [&](const std::vector<int>& some) {
    for_each_grid(static_cast<int>(some.size()), parallel,
                  [&](int job) { fill_level_set(some[static_cast<std::size_t>(job)]); });
  };
  fill(tooth.parts ? std::vector<int>{kDentin, kAlways, kAlways + 1} : std::vector<int>{kDentin});
  fill({kDentin - 1, kDentin + 1});
  check_parts(path, tooth);
  if (level_sets.size() > kTissues) {
    tooth.parts->tissues = tooth.remains;
    for_each_grid(3, parallel, [&](int k) {
      fill_level_set(kTissues + k);
      check_intact_tissue(path, tooth, static_cast<std::size_t>(k));
    });
  }
  read_way(path, archive, tooth);
  read_bodies(path, archive, tooth);

  static const std::set<std::string> kOwn = {kSchemaKey, kVersionKey, kVoxelKey, kHashKey,
                                             kBodiesKey};
  for (auto it = archive.meta->beginMeta(); it != archive.meta->endMeta(); ++it)
    if (!kOwn.count(it->first) && it->first.rfind(kVolumePrefix, 0) != 0 && it->second)
      tooth.provenance[it->first] = it->second->str();
  return tooth;
}

// Reads what nobody vouches for in a child process, whose crash is a refusal.
void try_reading(const std::string& path, std::span<char> bytes) {
  const std::size_t memory = kTrialMemory + kTrialMemoryPerByte * bytes.size();
  const double seconds = kTrialSeconds + kTrialSecondsPerByte * static_cast<double>(bytes.size());
  const auto failure = failure_in_trial(
      [&] {
        limit_trial(seconds, memory);
        tooth_of(path, parse(path, bytes), /*parallel=*/false);
      },
      static_cast<unsigned>(20 * seconds), memory);
  if (!failure) return;
  if (failure->input) throw *failure->input;
  throw InputError(path, "", std::string(kDamaged) + ": reading it fails, or takes too much memory",
                   kAgain);
}

// Where a tooth is: within a scanner's reach of its origin, and no larger than a jaw.
void judge_place(const std::string& path, const LayeredTooth& tooth,
                 std::vector<std::string>& warnings) {
  const Box box = bounds_of_solid(tooth);
  const double away = std::max(box.min.cwiseAbs().maxCoeff(), box.max.cwiseAbs().maxCoeff());
  const double size = (box.max - box.min).maxCoeff();
  if (away > kFarthest)
    warnings.push_back(path + ": the tooth lies " + text_of(away) +
                       " mm from the origin, where no scan has it; is its transform in mm?");
  else if (size > kLargest)
    warnings.push_back(path + ": the tooth is " + text_of(size) +
                       " mm large; is its transform in mm?");
}

}  // namespace

ToothReading read_tooth_with_warnings(const std::string& path, ReadPolicy policy) {
  openvdb::initialize();
  Content content = content_of(path);
  if (!content.ours && policy == ReadPolicy::kTrial) try_reading(path, content.file.all());
  const Archive archive =
      content.ours ? parse_ours(path, content.file.all()) : parse(path, content.file.all());
  if (!content.ours) content.file = {};
  ToothReading reading{tooth_of(path, archive, /*parallel=*/true), {}};
  content.file = {};
  auto stored = find_text(*archive.meta, kHashKey);
  for (const auto& grid : *archive.grids)
    if (!stored && grid) stored = find_text(*grid, kHashKey);
  if (!content.ours && stored && *stored != tooth_sha256(reading.tooth))
    reading.warnings.push_back(
        path + ": is not the tooth that its tooth_sha256 is of: another program changed it");
  judge_place(path, reading.tooth, reading.warnings);
  return reading;
}

LayeredTooth read_tooth(const std::string& path, ReadPolicy policy) {
  return read_tooth_with_warnings(path, policy).tooth;
}

void write_tooth(const LayeredTooth& tooth, const std::string& path) {
  openvdb::initialize();
  const auto tissue = Int32Grid::create(0);
  std::vector<FloatGrid::Ptr> level_sets(static_cast<std::size_t>(level_sets_of(tooth)));
  openvdb::GridPtrVec grids{tissue};
  describe(*tissue, "tissue", tooth);
  for (int k = 0; k < level_sets_of(tooth); ++k) {
    level_sets[k] = FloatGrid::create(tooth.solid.background());
    if (k < kTissues) level_sets[k]->setGridClass(openvdb::GRID_LEVEL_SET);  // as a whole
    describe(*level_sets[k], kLevelSetNames[k], tooth);
    grids.push_back(level_sets[k]);
  }
  const Int32Grid::Ptr body = body_grid(tooth);
  if (tooth.bodies) {
    describe(*body, kBodyGrid, tooth);
    body->insertMeta(kBodiesKey, openvdb::StringMetadata(bodies_text(tooth.bodies->list)));
    grids.push_back(body);
  }
  Int32Grid::Ptr way;
  openvdb::MetaMap meta;
  tbb::parallel_for(-1, 2 + level_sets_of(tooth), [&](int job) {
    if (job == -1) {
      way = way_grid(tooth);
    } else if (job == 0) {
      meta = file_metadata(tooth);
    } else if (job == 1) {
      fill_tree(*tissue, tooth.tissue, [](std::uint8_t v) { return v != 0; });
    } else {
      const float band = tooth.solid.background();
      const int k = job - 2;
      const auto in_band = [band](float v) { return std::abs(v) < band; };
      with_level_set(tooth, k, [&](const auto& bricks) {
        if (k < kTissues)
          fill_tree(*level_sets[k], bricks, in_band);
        else
          fill_tree(*level_sets[k], bricks, in_band,
                    [&](std::size_t b) { return has_changed(tooth, k - kTissues, b); });
      });
    }
  });
  if (tooth.parts && tooth.parts->way) grids.push_back(way);
  // Programs that rewrite a .vdb tend to keep the grids' metadata and drop the file's.
  for (const auto& grid : grids) grid->insertMeta(kHashKey, *meta[kHashKey]);
  std::string bytes = archive_of(grids, meta);
  if (bytes.size() < kIdOffset + kIdLength || !looks_like_uuid(bytes.data() + kIdOffset))
    throw Error(path + ": this version of OpenVDB writes a header that toothprep does not know");
  Sha256 hash;
  hash_head(hash, bytes);
  const std::string id = id_of_content(hash);
  bytes.replace(kIdOffset, kIdLength, id);
  write_file(path, bytes);
}

}  // namespace toothprep
