// Signed distance to the bur: the smallest distance to any piece of the outline, and the sign from
// a crossing test.
//
// Sign. A point is inside if a ray from it towards +r crosses the outline an odd number of times.
// Every piece is monotone in z and counts for z_low <= z < z_high; neighbours share that bound to
// the last bit, so exactly one of them counts at a joint. The axis lies behind the ray and is never
// met, which is why it needs no piece. Rounding can move the outline by an ulp only, where the
// distance itself is an ulp: the sign cannot fail at corners, as one taken from the nearest piece's
// normal does.
//
// Both precisions run the same formulas. mitred_distances() runs them over short blocks with the pieces
// outside and the points inside, without a branch, so that the compiler vectorises the inner loops
// (at -O3; sqrt needs -fno-math-errno, set for this file in CMakeLists.txt). They are compiled for
// SSE2 and for AVX2 without fused multiply-add; each point's operations are the same in both, and so
// are the bits of its distance (tests/step/bur/test_distance.cpp).
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "toothprep/step/bur/distance_kernels.h"
#include "toothprep/step/core/processor.h"

namespace toothprep {
namespace {

// Points per block: all that a row of one brick of voxels needs. Unrolled in full such short loops
// would no longer be vectorised by GCC.
constexpr int kBlock = 8;
#if defined(__GNUC__) && !defined(__clang__)
#define TOOTHPREP_KEEP_LOOP _Pragma("GCC unroll 1")
#else
#define TOOTHPREP_KEEP_LOOP
#endif

template <int N, class T>
TOOTHPREP_INLINE void measure(const typename DistanceOutline<T>::Line& p, const T* r, const T* z,
                              T* squared, int* inside) {
  const T mid_r = p.mid_r, mid_z = p.mid_z, u_r = p.u_r, u_z = p.u_z, half = p.half_length;
  const T low = p.z_low, high = p.z_high;
  TOOTHPREP_KEEP_LOOP
  for (int i = 0; i < N; ++i) {
    const T q_r = r[i] - mid_r, q_z = z[i] - mid_z;
    const T off = q_r * u_z - q_z * u_r;  // to the right of the line
    const T past = std::abs(q_r * u_r + q_z * u_z) - half;
    const T over = past > T(0) ? past : T(0);
    const T s = off * off + over * over;
    squared[i] = s < squared[i] ? s : squared[i];
    inside[i] ^= int(z[i] >= low) & int(z[i] < high) & int(off < T(0));
  }
}

// With q from the arc's middle, u outward there, k the curvature and c the place from the centre: w
// = k q.q + 2 q.u is (|c|^2 - radius^2) k, and the distance from the circle is w / (1 + k |c|). No
// difference of large numbers, however flat the arc, and no root of a difference near the centre.
template <class T>
struct FromCircle {
  T c_r, w;  // mm: of the place from the centre along r; as above
  T distance;
  TOOTHPREP_INLINE FromCircle(const typename DistanceOutline<T>::Arc& a, T r, T z) {
    const T q_r = r - a.mid_r, q_z = z - a.mid_z, c_z = z - a.centre_z;
    w = a.curvature * (q_r * q_r + q_z * q_z) + T(2) * (q_r * a.out_r + q_z * a.out_z);
    c_r = r - a.centre_r;
    distance = w / (T(1) + a.curvature * std::sqrt(c_r * c_r + c_z * c_z));
  }
};

template <int N, bool kRight, class T>
TOOTHPREP_INLINE void measure(const typename DistanceOutline<T>::Arc& p, const T* r, const T* z,
                              T* squared, int* inside) {
  const typename DistanceOutline<T>::Arc a = p;  // a copy: the outputs can't alias it
  TOOTHPREP_KEEP_LOOP
  for (int i = 0; i < N; ++i) {
    const FromCircle<T> from(a, r[i], z[i]);
    const T off = from.distance;
    const T before = a.from_out_r * (z[i] - a.from_z) - a.from_out_z * (r[i] - a.from_r);
    const T after = (r[i] - a.to_r) * a.to_out_z - (z[i] - a.to_z) * a.to_out_r;
    const int facing = int(before >= T(0)) & int(after >= T(0));
    const T s = facing ? off * off : std::numeric_limits<T>::max();
    squared[i] = s < squared[i] ? s : squared[i];
    const int far = int(from.c_r < T(0));
    const int left = kRight ? far | int(off < T(0)) : far & int(off > T(0));
    inside[i] ^= int(z[i] >= a.z_low) & int(z[i] < a.z_high) & left;
  }
}

template <int N, class T>
TOOTHPREP_INLINE void measure(const typename DistanceOutline<T>::Point& p, const T* r, const T* z,
                              T* squared) {
  TOOTHPREP_KEEP_LOOP
  for (int i = 0; i < N; ++i) {
    const T q_r = r[i] - p.r, q_z = z[i] - p.z, s = q_r * q_r + q_z * q_z;
    squared[i] = s < squared[i] ? s : squared[i];
  }
}

// Where the corner is nearest, past the end of the one face and before the beginning of the other,
// the larger of the distances from their planes.
template <int N, class T>
TOOTHPREP_INLINE void mitre(const typename DistanceOutline<T>::Corner& p, const T* r, const T* z,
                            T* out) {
  const typename DistanceOutline<T>::Corner c = p;
  TOOTHPREP_KEEP_LOOP
  for (int i = 0; i < N; ++i) {
    const T q_r = r[i] - c.r, q_z = z[i] - c.z, d = out[i];
    const T past = q_r * c.from_r + q_z * c.from_z, before = q_r * c.to_r + q_z * c.to_z;
    const T from = q_r * c.from_z - q_z * c.from_r, to = q_r * c.to_z - q_z * c.to_r;
    const T larger = from > to ? from : to;
    const int nearest = int(past >= T(0)) & int(before <= T(0)) & int(larger < d);
    out[i] = nearest ? larger : d;
  }
}

template <int N, class T>
TOOTHPREP_INLINE void signed_distances(const DistanceOutline<T>& outline, const T* r, const T* z,
                                       T* out) {
  T squared[N];
  int inside[N];
  TOOTHPREP_KEEP_LOOP
  for (int i = 0; i < N; ++i) {
    squared[i] = std::numeric_limits<T>::max();
    inside[i] = 0;
  }
  for (const auto& p : outline.lines) measure<N, T>(p, r, z, squared, inside);
  for (const auto& p : outline.right_arcs) measure<N, true, T>(p, r, z, squared, inside);
  for (const auto& p : outline.left_arcs) measure<N, false, T>(p, r, z, squared, inside);
  for (const auto& p : outline.points) measure<N, T>(p, r, z, squared);
  TOOTHPREP_KEEP_LOOP
  for (int i = 0; i < N; ++i) {
    const T d = std::sqrt(squared[i]);
    out[i] = inside[i] ? -d : d;
  }
  for (const auto& c : outline.corners) mitre<N, T>(c, r, z, out);
}

// Of a piece that is nowhere near to the points, the crossing test alone.
template <int N>
TOOTHPREP_INLINE void cross(const DistanceOutline<float>::Line& p, const float* r, const float* z,
                            int* inside) {
  const DistanceOutline<float>::Line l = p;
  TOOTHPREP_KEEP_LOOP
  for (int i = 0; i < N; ++i) {
    const float off = (r[i] - l.mid_r) * l.u_z - (z[i] - l.mid_z) * l.u_r;
    inside[i] ^= int(z[i] >= l.z_low) & int(z[i] < l.z_high) & int(off < 0);
  }
}
template <int N, bool kRight>
TOOTHPREP_INLINE void cross(const DistanceOutline<float>::Arc& p, const float* r, const float* z,
                            int* inside) {
  const DistanceOutline<float>::Arc a = p;
  TOOTHPREP_KEEP_LOOP
  for (int i = 0; i < N; ++i) {
    const FromCircle<float> from(a, r[i], z[i]);
    const int far = int(from.c_r < 0);
    const int left = kRight ? far | int(from.w < 0) : far & int(from.w > 0);
    inside[i] ^= int(z[i] >= a.z_low) & int(z[i] < a.z_high) & left;
  }
}

// Which pieces matter to the points in a ball: as near to its middle as the nearest of them, but for the
// ball's diameter, for the distance; at its height, for the sign.
class NearPieces {
 public:
  TOOTHPREP_INLINE NearPieces(const DistanceOutline<float>& outline, const DistanceBall& ball)
      : ball_(ball), radius_(ball.radius + kBeyondRounding) {
    float squared = std::numeric_limits<float>::max();
    int inside = 0;
    for (const auto& p : outline.lines) measure<1, float>(p, &ball.r, &ball.z, &squared, &inside);
    for (const auto& p : outline.right_arcs)
      measure<1, true, float>(p, &ball.r, &ball.z, &squared, &inside);
    for (const auto& p : outline.left_arcs)
      measure<1, false, float>(p, &ball.r, &ball.z, &squared, &inside);
    for (const auto& p : outline.points) measure<1, float>(p, &ball.r, &ball.z, &squared);
    reach_ = std::sqrt(squared) + 2 * radius_;
  }
  TOOTHPREP_INLINE bool may_be_nearest(const DistanceOutline<float>::Line& p) const {
    float squared = std::numeric_limits<float>::max();
    int inside = 0;
    measure<1, float>(p, &ball_.r, &ball_.z, &squared, &inside);
    return squared <= reach_ * reach_;
  }
  // Of an arc, by its circle.
  TOOTHPREP_INLINE bool may_be_nearest(const DistanceOutline<float>::Arc& p) const {
    return std::abs(FromCircle<float>(p, ball_.r, ball_.z).distance) <= reach_;
  }
  TOOTHPREP_INLINE bool may_be_nearest(const DistanceOutline<float>::Corner& c) const {
    const float q_r = ball_.r - c.r, q_z = ball_.z - c.z;
    return q_r * c.from_r + q_z * c.from_z >= -radius_ && q_r * c.to_r + q_z * c.to_z <= radius_;
  }
  template <class Piece>
  TOOTHPREP_INLINE bool may_be_crossed(const Piece& p) const {
    return p.z_low < p.z_high && p.z_low <= ball_.z + radius_ && p.z_high >= ball_.z - radius_;
  }

 private:
  static constexpr float kBeyondRounding = 1e-3f;  // mm
  const DistanceBall ball_;
  float radius_, reach_;
};

// The same for points in a ball: what can't matter to any of them is left out.
template <int N>
TOOTHPREP_INLINE void signed_distances_near(const DistanceOutline<float>& outline,
                                            const DistanceBall& ball, const float* r,
                                            const float* z, float* out) {
  const NearPieces near(outline, ball);
  // 0, which the compiler doesn't know: it would have the processor fill the array byte by byte (`rep stos`).
  const int outside = ball.radius < 0 ? 1 : 0;
  float squared[N];
  int inside[N];
  TOOTHPREP_KEEP_LOOP
  for (int i = 0; i < N; ++i) {
    squared[i] = std::numeric_limits<float>::max();
    inside[i] = outside;
  }
  for (const auto& p : outline.lines)
    if (near.may_be_nearest(p))
      measure<N, float>(p, r, z, squared, inside);
    else if (near.may_be_crossed(p))
      cross<N>(p, r, z, inside);
  for (const auto& p : outline.right_arcs)
    if (near.may_be_nearest(p))
      measure<N, true, float>(p, r, z, squared, inside);
    else if (near.may_be_crossed(p))
      cross<N, true>(p, r, z, inside);
  for (const auto& p : outline.left_arcs)
    if (near.may_be_nearest(p))
      measure<N, false, float>(p, r, z, squared, inside);
    else if (near.may_be_crossed(p))
      cross<N, false>(p, r, z, inside);
  for (const auto& p : outline.points) measure<N, float>(p, r, z, squared);
  TOOTHPREP_KEEP_LOOP
  for (int i = 0; i < N; ++i) {
    const float d = std::sqrt(squared[i]);
    out[i] = inside[i] ? -d : d;
  }
  for (const auto& c : outline.corners)
    if (near.may_be_nearest(c)) mitre<N, float>(c, r, z, out);
}

// Of each point of a block how far it is from the first along each axis, voxels.
constexpr auto kSteps = [] {
  std::array<std::array<float, kDistanceBlock>, 3> steps{};
  for (int p = 0; p < kDistanceBlock; ++p)
    for (int axis = 2, rest = p; axis >= 0; --axis, rest /= kBlockEdge)
      steps[axis][p] = static_cast<float>(rest % kBlockEdge);
  return steps;
}();

TOOTHPREP_INLINE void places(const float* to_bur, const float* first, float* r, float* z) {
  std::array<float, 9> m;  // copies: the outputs can't alias them
  std::copy(to_bur, to_bur + 9, m.begin());
  const float first_x = first[0], first_y = first[1], first_z = first[2];
  for (int p = 0; p < kDistanceBlock; ++p) {
    const float x = first_x + kSteps[0][p], y = first_y + kSteps[1][p], w = first_z + kSteps[2][p];
    const float bx = m[0] * x + m[1] * y + m[2] * w, by = m[3] * x + m[4] * y + m[5] * w;
    r[p] = std::sqrt(bx * bx + by * by);
    z[p] = m[6] * x + m[7] * y + m[8] * w;
  }
}

TOOTHPREP_INLINE void distances_by_block(const DistanceOutline<float>& outline, const float* r,
                                         const float* z, float* out, int n) {
  int i = 0;
  for (; i + kBlock <= n; i += kBlock) signed_distances<kBlock>(outline, r + i, z + i, out + i);
  if (i == n) return;
  float rest_r[kBlock] = {}, rest_z[kBlock] = {}, rest[kBlock];  // the last block, filled up
  std::copy(r + i, r + n, rest_r);
  std::copy(z + i, z + n, rest_z);
  signed_distances<kBlock>(outline, rest_r, rest_z, rest);
  std::copy(rest, rest + (n - i), out + i);
}

void plain(const DistanceOutline<float>& outline, const float* r, const float* z, float* out,
           int n) {
  distances_by_block(outline, r, z, out, n);
}
void plain_near(const DistanceOutline<float>& outline, const DistanceBall& ball, const float* r,
                const float* z, float* out) {
  signed_distances_near<kDistanceBlock>(outline, ball, r, z, out);
}
void plain_places(const float* to_bur, const float* first, float* r, float* z) {
  places(to_bur, first, r, z);
}

#if defined(__x86_64__) && defined(__GNUC__)
__attribute__((target("avx2"))) void with_avx2(const DistanceOutline<float>& outline,
                                               const float* r, const float* z, float* out, int n) {
  distances_by_block(outline, r, z, out, n);
}
__attribute__((target("avx2"))) void near_with_avx2(const DistanceOutline<float>& outline,
                                                    const DistanceBall& ball, const float* r,
                                                    const float* z, float* out) {
  signed_distances_near<kDistanceBlock>(outline, ball, r, z, out);
}
__attribute__((target("avx2"))) void places_with_avx2(const float* to_bur, const float* first,
                                                      float* r, float* z) {
  places(to_bur, first, r, z);
}
#endif

// Chosen when the program is loaded: a tick must neither allocate nor wait for another's choice.
const DistanceKernel kPlain = {"plain", plain, plain_near, plain_places};
#if defined(__x86_64__) && defined(__GNUC__)
const DistanceKernel kFastest =
    has_avx2() ? DistanceKernel{"fastest", with_avx2, near_with_avx2, places_with_avx2} : kPlain;
#else
const DistanceKernel kFastest = kPlain;
#endif

}  // namespace

std::vector<DistanceKernel> distance_kernels() {
  std::vector<DistanceKernel> kernels = {kPlain};
  if (has_avx2()) kernels.push_back(kFastest);
  return kernels;
}

double Bur::distance(double r, double z) const noexcept {
  double d;
  signed_distances<1>(exact_, &r, &z, &d);
  return d;
}

void Bur::mitred_distances(const float* r, const float* z, float* out, int n) const noexcept {
  kFastest.run(fast_, r, z, out, n);
}

void Bur::mitred_distances_near(const DistanceBall& ball, const float* r, const float* z,
                                float* out) const noexcept {
  kFastest.run_near(fast_, ball, r, z, out);
}

void places_of_block(const float* to_bur, const float* first, float* r, float* z) noexcept {
  kFastest.places(to_bur, first, r, z);
}

}  // namespace toothprep
