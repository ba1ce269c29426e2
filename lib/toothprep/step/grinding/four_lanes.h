// Four numbers at a time, by the compilers' own vector types: SSE2 on every x86-64, NEON on arm64,
// the same operations in the same order everywhere. Internal to this folder.
#pragma once

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

#include <cmath>
#include <cstdint>
#include <cstring>

namespace toothprep {

using Float4 = float __attribute__((vector_size(16)));
using Int4 = std::int32_t __attribute__((vector_size(16)));

[[nodiscard]] inline Float4 load4(const float* from) noexcept {
  Float4 x;
  std::memcpy(&x, from, sizeof x);
  return x;
}
inline void store4(Float4 x, float* to) noexcept { std::memcpy(to, &x, sizeof x); }
[[nodiscard]] inline Float4 all4(float x) noexcept { return Float4{x, x, x, x}; }
[[nodiscard]] inline Int4 truncated(Float4 x) noexcept { return __builtin_convertvector(x, Int4); }
[[nodiscard]] inline Float4 as_float(Int4 x) noexcept { return __builtin_convertvector(x, Float4); }

// Also of single floats, so that a formula can be tested by itself.
template <class T>
[[nodiscard]] inline T least(T a, T b) noexcept {
  return a < b ? a : b;
}
template <class T>
[[nodiscard]] inline T greatest(T a, T b) noexcept {
  return a > b ? a : b;
}
template <class T>
[[nodiscard]] inline T magnitude(T a) noexcept {
  return a < 0 ? -a : a;
}
// x with its sign turned where a < 0.
template <class T>
[[nodiscard]] inline T turned_where_negative(T a, T x) noexcept {
  return a < 0 ? -x : x;
}
[[nodiscard]] inline Float4 square_root(Float4 a) noexcept {
#if defined(__SSE2__)
  return _mm_sqrt_ps(a);
#else
  return Float4{std::sqrt(a[0]), std::sqrt(a[1]), std::sqrt(a[2]), std::sqrt(a[3])};
#endif
}
#if defined(__SSE2__)
// The same by one instruction each, which GCC doesn't find by itself.
template <>
[[nodiscard]] inline Float4 least(Float4 a, Float4 b) noexcept {
  return _mm_min_ps(a, b);
}
template <>
[[nodiscard]] inline Float4 greatest(Float4 a, Float4 b) noexcept {
  return _mm_max_ps(a, b);
}
template <>
[[nodiscard]] inline Float4 magnitude(Float4 a) noexcept {
  return _mm_andnot_ps(all4(-0.0f), a);
}
template <>
[[nodiscard]] inline Float4 turned_where_negative(Float4 a, Float4 x) noexcept {
  return _mm_xor_ps(_mm_and_ps(_mm_cmplt_ps(a, Float4{}), all4(-0.0f)), x);
}
#endif
[[nodiscard]] inline Float4 within(const Float4& value, const Float4& bound) noexcept {
  return least(greatest(value, -bound), bound);
}

// Of lanes that are -1 or 0 each: whether any, or all, are -1.
[[nodiscard]] inline bool any(Int4 a) noexcept {
#if defined(__SSE2__)
  return _mm_movemask_ps(reinterpret_cast<__m128>(a)) != 0;
#else
  return (a[0] | a[1] | a[2] | a[3]) != 0;
#endif
}
[[nodiscard]] inline bool all(Int4 a) noexcept {
#if defined(__SSE2__)
  return _mm_movemask_ps(reinterpret_cast<__m128>(a)) == 15;
#else
  return (a[0] & a[1] & a[2] & a[3]) != 0;
#endif
}

// The same, a bit per lane; and lanes of such bits.
[[nodiscard]] inline std::uint8_t bits_of(Int4 a) noexcept {
#if defined(__SSE2__)
  return static_cast<std::uint8_t>(_mm_movemask_ps(reinterpret_cast<__m128>(a)));
#else
  return static_cast<std::uint8_t>((a[0] & 1) | (a[1] & 2) | (a[2] & 4) | (a[3] & 8));
#endif
}
[[nodiscard]] inline Int4 lanes_of(std::uint8_t bits) noexcept {
  return (Int4{1, 2, 4, 8} & std::int32_t{bits}) != 0;
}

[[nodiscard]] inline float least_of(Float4 a) noexcept {
  return least(least(a[0], a[1]), least(a[2], a[3]));
}

// Rows to columns.
inline void transpose(Float4& a, Float4& b, Float4& c, Float4& d) noexcept {
#if defined(__clang__)
  const Float4 ab = __builtin_shufflevector(a, b, 0, 4, 1, 5),
               cd = __builtin_shufflevector(c, d, 0, 4, 1, 5),
               AB = __builtin_shufflevector(a, b, 2, 6, 3, 7),
               CD = __builtin_shufflevector(c, d, 2, 6, 3, 7);
  a = __builtin_shufflevector(ab, cd, 0, 1, 4, 5), b = __builtin_shufflevector(ab, cd, 2, 3, 6, 7);
  c = __builtin_shufflevector(AB, CD, 0, 1, 4, 5), d = __builtin_shufflevector(AB, CD, 2, 3, 6, 7);
#else
  const Int4 low{0, 4, 1, 5}, high{2, 6, 3, 7}, first{0, 1, 4, 5}, last{2, 3, 6, 7};
  const Float4 ab = __builtin_shuffle(a, b, low), cd = __builtin_shuffle(c, d, low),
               AB = __builtin_shuffle(a, b, high), CD = __builtin_shuffle(c, d, high);
  a = __builtin_shuffle(ab, cd, first), b = __builtin_shuffle(ab, cd, last);
  c = __builtin_shuffle(AB, CD, first), d = __builtin_shuffle(AB, CD, last);
#endif
}

}  // namespace toothprep
