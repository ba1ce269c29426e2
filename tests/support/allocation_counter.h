// Counts the calls of global operator new. It replaces the global operators: for a program of its
// own, included once, and not with the sanitizers, which bring their own.
#pragma once

#include <cstdlib>
#include <new>

namespace toothprep::testing {
inline long allocations = 0;
}

void* operator new(std::size_t size) {
  ++toothprep::testing::allocations;
  if (void* p = std::malloc(size)) return p;
  throw std::bad_alloc();
}
void operator delete(void* p) noexcept { std::free(p); }
void operator delete(void* p, std::size_t) noexcept { std::free(p); }
