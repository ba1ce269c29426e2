#include <gtest/gtest.h>

#include <cstdio>
#include <fstream>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/hash.h"

namespace toothprep {
namespace {

std::string sha256_of(const std::string& text) {
  Sha256 hash;
  hash.update(text.data(), text.size());
  return hash.hex();
}

// FIPS 180-2, appendix B.1 and B.3, and the digest of the empty message.
TEST(Sha256, MatchesThePublishedExamples) {
  EXPECT_EQ(sha256_of("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(sha256_of(std::string(1000000, 'a')),
            "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
  EXPECT_EQ(sha256_of(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
}

TEST(Sha256, OfAFileIsThatOfItsBytesWhateverTheBufferSize) {
  const std::string path = ::testing::TempDir() + "toothprep_hash_test.bin";
  std::string bytes((1 << 20) + 17, '\0');  // more than one buffer
  for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<char>(i * 7);
  std::ofstream(path, std::ios::binary) << bytes;
  EXPECT_EQ(sha256_of_file(path), sha256_of(bytes));
  std::remove(path.c_str());
}

TEST(Sha256, OfAnAbsentFileIsAnErrorThatNamesIt) {
  try {
    sha256_of_file("no/such/file");
    FAIL();
  } catch (const InputError& e) {
    EXPECT_NE(std::string(e.what()).find("no/such/file"), std::string::npos);
  }
}

}  // namespace
}  // namespace toothprep
