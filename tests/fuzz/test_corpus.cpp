// Every file of tests/fuzz/corpus through its reader: inputs that once broke one, and one of each
// kind of damage. Nothing but an Error may come out, and the file `good*` of a reader must be taken.
#include <gtest/gtest.h>
#include <zlib.h>

#include <algorithm>
#include <filesystem>

#include "fuzz_target.h"

namespace toothprep::fuzz {

// For the names of tests.
void PrintTo(const Target& target, std::ostream* out) { *out << target.name; }

namespace {

namespace fs = std::filesystem;

const fs::path kCorpus = fs::path(TOOTHPREP_SOURCE_DIR) / "tests" / "fuzz" / "corpus";

std::vector<fs::path> files_of(const Target& target) {
  std::vector<fs::path> files;
  if (fs::is_directory(kCorpus / target.name))
    for (const auto& entry : fs::directory_iterator(kCorpus / target.name))
      files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  return files;
}

// Large ones are packed by gzip.
std::vector<std::uint8_t> unpacked(const fs::path& file) {
  const gzFile in = gzopen(file.c_str(), "rb");
  std::vector<std::uint8_t> bytes(4 << 20);
  const int size = gzread(in, bytes.data(), static_cast<unsigned>(bytes.size()));
  EXPECT_GE(size, 0);
  gzclose(in);
  bytes.resize(static_cast<std::size_t>(std::max(size, 0)));
  return bytes;
}

class Corpus : public testing::TestWithParam<Target> {};

TEST_P(Corpus, IsTakenOrRefusedByAnErrorAndNothingElse) {
  const auto files = files_of(GetParam());
  ASSERT_FALSE(files.empty()) << "no corpus for this reader";
  int good = 0;
  for (const fs::path& file : files) {
    SCOPED_TRACE(file.filename().string());
    const std::vector<std::uint8_t> bytes = unpacked(file);
    bool taken = false;
    EXPECT_NO_THROW(taken = read_bytes(GetParam(), bytes.data(), bytes.size()));
    if (file.filename().string().rfind("good", 0) != 0) continue;
    ++good;
    EXPECT_TRUE(taken);
  }
  EXPECT_GT(good, 0) << "without a good file nothing says that the reader is reached";
}

INSTANTIATE_TEST_SUITE_P(Readers, Corpus, testing::ValuesIn(targets()),
                         [](const auto& reader) { return reader.param.name; });

TEST(CorpusFolder, BelongsToAReader) {
  for (const auto& entry : fs::directory_iterator(kCorpus)) {
    const std::string name = entry.path().filename().string();
    EXPECT_TRUE(std::any_of(targets().begin(), targets().end(), [&](const Target& t) {
      return t.name == name;
    })) << name;
  }
}

}  // namespace
}  // namespace toothprep::fuzz
