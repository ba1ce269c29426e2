// The program's large blocks of memory lie on huge pages where the system has them. Nothing else
// depends on it.
#ifndef TOOTHPREP_SANITIZED  // sanitizers have their own
#include <cstdlib>
#include <new>

#include "toothprep/step/core/huge_pages.h"

namespace {

using toothprep::kHugePage;

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
