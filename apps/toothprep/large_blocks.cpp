// The program's large blocks of memory have mappings of their own, which go back to the system when they are
// freed, on huge pages where the system has them. Nothing else depends on it.
#ifndef TOOTHPREP_SANITIZED  // sanitizers have their own
#include <malloc.h>

#include <cstdlib>
#include <new>

#include "toothprep/step/core/huge_pages.h"

namespace {

using toothprep::kHugePage;

// Otherwise each large block that is freed raises the size from which blocks are mapped, up to 32 MiB. The rest
// of the heap stays with the program: one limit that is set leaves the other at its least, 128 KiB.
[[maybe_unused]] const int mapped_alone =
    mallopt(M_MMAP_THRESHOLD, toothprep::kLeastOnHugePages) &
    mallopt(M_TRIM_THRESHOLD, 16 * toothprep::kLeastOnHugePages);

void* find_block(std::size_t size) noexcept {
  if (size < toothprep::kLeastOnHugePages) return std::malloc(size > 0 ? size : 1);
  void* block = nullptr;
  if (posix_memalign(&block, kHugePage, size) != 0) return nullptr;
  toothprep::advise_huge_pages(block, size);
  return block;
}

}  // namespace

void* operator new(std::size_t size) {
  while (true) {
    if (void* block = find_block(size)) return block;
    const std::new_handler make_room = std::get_new_handler();
    if (!make_room) throw std::bad_alloc();
    make_room();
  }
}
void operator delete(void* block) noexcept { std::free(block); }
void operator delete(void* block, std::size_t) noexcept { std::free(block); }
#endif
