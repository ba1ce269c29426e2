// The program's heap.
#include <gtest/gtest.h>

#include <cstdint>
#include <cstdio>
#include <fstream>
#include <memory>
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

#ifdef TOOTHPREP_SANITIZED
constexpr bool kOurs = false;
#else
constexpr bool kOurs = true;
#endif

// The system's answer to "for whom are huge pages": the choice in brackets.
bool are_huge_pages_for_who_asks() {
  std::ifstream in("/sys/kernel/mm/transparent_hugepage/enabled");
  std::string choices;
  return std::getline(in, choices) && choices.find("[madvise]") != std::string::npos;
}

TEST(Heap, LiesOnHugePages) {
  if (!kOurs || !are_huge_pages_for_who_asks())
    GTEST_SKIP() << "a sanitizer's heap, or a system whose huge pages are for all or for none";
  const auto small = std::make_unique<int>(1);
  EXPECT_TRUE(is_advised(small.get()));
  for (const std::size_t size :
       {std::size_t{1} << 16, std::size_t{4} << 20, (std::size_t{16} << 20) + 1}) {
    const std::vector<char> block(size, 'a');
    EXPECT_TRUE(is_advised(block.data())) << size;
    EXPECT_TRUE(is_advised(&block.back())) << size;
  }
}

}  // namespace
