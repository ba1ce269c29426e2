// Huge pages: a fault for each page of 4 KiB takes longer than what many commands do with what they
// read. Not for what a step is the first to touch: that a huge page is made takes too long for it.
#pragma once

#ifdef __linux__
#include <sys/mman.h>
#endif

#include <cstddef>
#include <cstdint>

namespace toothprep {

constexpr std::size_t kHugePage = std::size_t{1} << 21;   // bytes, of x86-64 and most of ARM
constexpr std::size_t kLeastOnHugePages = 2 * kHugePage;  // bytes of a block that is worth them

// Advises the system to lay the pages that lie whole in a block on huge ones. Where it has none, and
// of a block that is too small, nothing changes.
inline void advise_huge_pages([[maybe_unused]] const void* block,
                              [[maybe_unused]] std::size_t bytes) {
#ifdef __linux__
  constexpr std::uintptr_t kPage = 4096;
  if (bytes < kLeastOnHugePages) return;
  const auto at = reinterpret_cast<std::uintptr_t>(block);
  const std::uintptr_t first = (at + kPage - 1) / kPage * kPage;
  madvise(reinterpret_cast<void*>(first), at + bytes - first, MADV_HUGEPAGE);
#endif
}

}  // namespace toothprep
