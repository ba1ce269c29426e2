// The program's heap.
#include <gtest/gtest.h>
#include <jemalloc/jemalloc.h>

#include <cstdint>
#include <cstdio>
#include <fstream>
#include <memory>
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

// The system's answer to "for whom are huge pages", the choice in brackets; empty where it knows none.
std::string whose_huge_pages_are() {
  std::ifstream in("/sys/kernel/mm/transparent_hugepage/enabled");
  std::string choices;
  std::getline(in, choices);
  return choices;
}

void expect_advised() {
  const auto small = std::make_unique<int>(1);
  EXPECT_TRUE(is_advised(small.get()));
  for (const std::size_t size :
       {std::size_t{1} << 16, std::size_t{4} << 20, (std::size_t{16} << 20) + 1}) {
    const std::vector<char> block(size, 'a');
    EXPECT_TRUE(is_advised(block.data())) << size;
    EXPECT_TRUE(is_advised(&block.back())) << size;
  }
}

TEST(Heap, IsJemallocsAndAsksForHugePages) {
  const char* asked = nullptr;
  std::size_t size = sizeof asked;
  ASSERT_EQ(mallctl("opt.thp", &asked, &size, nullptr, 0), 0);
  const std::string whose = whose_huge_pages_are();
  EXPECT_STREQ(asked, whose.empty() ? "not supported" : "always");
  std::uint64_t before = 0, after = 0;
  size = sizeof before;
  ASSERT_EQ(mallctl("thread.allocated", &before, &size, nullptr, 0), 0);
  const std::vector<char> block(std::size_t{1} << 20, 'a');
  ASSERT_EQ(mallctl("thread.allocated", &after, &size, nullptr, 0), 0);
  EXPECT_GE(after, before + block.size());
  // Where they are for all or for none, there is nothing to ask the system for.
  if (whose.find("[madvise]") != std::string::npos) expect_advised();
}

// As the program says when memory is short.
TEST(Heap, OfMoreMemoryThanThereIsThrowsAfterTheHandlerWasAsked) {
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
