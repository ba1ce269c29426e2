// The program's own operator new.
#include <gtest/gtest.h>

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <new>
#include <string>
#include <vector>

namespace {

// Whether the system was advised to take huge pages for the mapping that holds the place.
bool is_advised(const void* place) {
  const auto at = reinterpret_cast<std::uintptr_t>(place);
  std::ifstream maps("/proc/self/smaps");
  bool here = false;
  for (std::string line; std::getline(maps, line);) {
    unsigned long first = 0, end = 0;
    if (std::sscanf(line.c_str(), "%lx-%lx ", &first, &end) == 2)
      here = first <= at && at < end;
    else if (here && line.rfind("VmFlags:", 0) == 0)
      return (line + ' ').find(" hg ") != std::string::npos;
  }
  return false;
}

// Whether the place lies in a mapping.
bool is_mapped(std::uintptr_t place) {
  std::ifstream maps("/proc/self/maps");
  for (std::string line; std::getline(maps, line);) {
    unsigned long first = 0, end = 0;
    if (std::sscanf(line.c_str(), "%lx-%lx ", &first, &end) == 2 && first <= place && place < end)
      return true;
  }
  return false;
}

#ifdef TOOTHPREP_SANITIZED
constexpr bool kOurs = false;
#else
constexpr bool kOurs = true;
#endif

TEST(LargeBlocks, AreAdvisedToLieOnHugePagesFromTheirFirstByteToTheirLast) {
  if (!kOurs || !std::filesystem::exists("/sys/kernel/mm/transparent_hugepage"))
    GTEST_SKIP() << "a sanitizer's operator new, or a system without huge pages";
  for (const std::size_t size : {std::size_t{4} << 20, (std::size_t{16} << 20) + 1}) {
    const std::vector<char> block(size, 'a');
    EXPECT_EQ(reinterpret_cast<std::uintptr_t>(block.data()) % (2 << 20), 0U);
    EXPECT_TRUE(is_advised(block.data()));
    EXPECT_TRUE(is_advised(&block.back()));
  }
}

// Also after a larger one was freed, and with a block behind it that stays.
TEST(LargeBlocks, AreTheSystemsAgainOnceFreed) {
  if (!kOurs || !std::filesystem::exists("/proc/self/maps"))
    GTEST_SKIP() << "a sanitizer's operator new, or a system without /proc";
  ::operator delete(::operator new (std::size_t{16} << 20));
  void* block = ::operator new (std::size_t{4} << 20);
  const std::vector<char> behind(std::size_t{1} << 16, 'a');
  const auto inside = reinterpret_cast<std::uintptr_t>(block) + (std::size_t{3} << 20);
  EXPECT_TRUE(is_mapped(inside));
  ::operator delete(block);
  EXPECT_FALSE(is_mapped(inside));
}

TEST(LargeBlocks, OfMoreMemoryThanThereIsThrowAfterTheHandlerWasAsked) {
  if (!kOurs) GTEST_SKIP() << "a sanitizer's operator new";
  static int asked;
  asked = 0;
  std::set_new_handler([] {
    if (++asked == 2) std::set_new_handler(nullptr);
  });
  volatile std::size_t size = PTRDIFF_MAX;
  EXPECT_THROW(::operator delete(::operator new(size)), std::bad_alloc);
  EXPECT_EQ(asked, 2);
}

}  // namespace
