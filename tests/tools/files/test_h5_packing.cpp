// Chunks packed and unpacked outside HDF5.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <memory>

#include "toothprep/tools/files/h5_packing.h"

namespace toothprep::h5 {
namespace {

// Chunks one after the other in a file without a name.
class ChunkFile {
 public:
  ChunkFile() : file_(std::tmpfile(), std::fclose) {}
  ChunkPlaces::Place add(const std::vector<char>& chunk) {
    const ChunkPlaces::Place place{size_, chunk.size()};
    if (!chunk.empty()) std::fwrite(chunk.data(), 1, chunk.size(), file_.get());
    std::fflush(file_.get());
    size_ += chunk.size();
    return place;
  }
  int descriptor() const { return fileno(file_.get()); }

 private:
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> file_;
  std::uint64_t size_ = 0;
};

template <class T>
std::vector<T> values_like(std::size_t count) {
  std::vector<T> values(count);
  for (std::size_t i = 0; i < count; ++i)
    values[i] = static_cast<T>(100 + 90 * std::sin(0.1 * static_cast<double>(i)));
  return values;
}

template <class T>
void expect_back(const std::vector<T>& given, std::size_t per_chunk) {
  const std::size_t count = given.size();
  ChunkFile file;
  ChunkPlaces chunks{{}, sizeof(T), per_chunk * sizeof(T)};
  for (const auto& chunk :
       packed_chunks(given.data(), count * sizeof(T), sizeof(T), chunks.chunk_size))
    chunks.places.push_back(file.add(chunk));
  for (const bool alone : {true, false}) {
    const auto back = unpacked_values(file.descriptor(), chunks, count, alone);
    ASSERT_TRUE(back);
    EXPECT_EQ(*back, std::vector<double>(given.begin(), given.end()));
  }
}

TEST(H5Packing, WhatWasPackedComesBackAsDoubles) {
  for (const std::size_t count : {1, 99, 100, 101, 5000}) {
    expect_back(values_like<double>(count), 100);
    expect_back(values_like<std::uint32_t>(count), 100);
    expect_back(values_like<std::uint8_t>(count), 100);
    expect_back(values_like<double>(count), 70000);  // noise of more than a stored block
  }
}

TEST(H5Packing, WhatStandsForSeveralChunksComesBackAsItWas) {
  for (const std::size_t changes : {0, 250, 300, 350, 499}) {
    std::vector<double> given(550, 0.5);
    std::fill(given.begin() + static_cast<std::ptrdiff_t>(changes), given.end(), 0.25);
    expect_back(given, 100);
  }
}

// Whatever the bytes of a chunk are, they are unpacked to just its size with the right checksum, or
// not at all. (What it must not do, reading or writing beyond, the sanitizers look for.)
TEST(H5Packing, DamagedChunksAreRefused) {
  const std::vector<double> given = values_like<double>(500);
  const std::vector<char> whole = packed_chunks(given.data(), 4000, sizeof(double), 4000).front();
  const auto unpacked = [](const std::vector<char>& bytes, std::size_t chunk_size) {
    ChunkFile file;
    const ChunkPlaces chunks{{file.add(bytes)}, sizeof(double), chunk_size};
    return unpacked_values(file.descriptor(), chunks, chunk_size / sizeof(double), true);
  };
  ASSERT_TRUE(unpacked(whole, 4000));
  for (const std::size_t wrong : {8, 3992, 4008, 40000}) EXPECT_FALSE(unpacked(whole, wrong));
  for (std::size_t length = 0; length < whole.size(); ++length)
    EXPECT_FALSE(
        unpacked({whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(length)}, 4000));
  for (std::size_t at = 0; at < whole.size(); ++at)
    for (const int bit : {1, 8, 128}) {
      std::vector<char> damaged = whole;
      damaged[at] = static_cast<char>(damaged[at] ^ bit);
      const auto values = unpacked(damaged, 4000);
      EXPECT_EQ(values.value_or(given), given) << at;  // of the level that its head claims
    }
}

TEST(H5Packing, ChunksBeyondTheFileAreRefused) {
  const std::vector<double> given(10, 1.5);
  ChunkFile file;
  ChunkPlaces chunks{{file.add(packed_chunks(given.data(), 80, 8, 80).front())}, 8, 80};
  ASSERT_TRUE(unpacked_values(file.descriptor(), chunks, 10, true));
  ++chunks.places[0].size;
  EXPECT_FALSE(unpacked_values(file.descriptor(), chunks, 10, true));
  chunks.places[0] = {std::uint64_t{1} << 62, 20};
  EXPECT_FALSE(unpacked_values(file.descriptor(), chunks, 10, true));
}

}  // namespace
}  // namespace toothprep::h5
