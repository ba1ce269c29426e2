#include "toothprep/step/grinding/contact_set.h"

#include <algorithm>
#include <limits>

#include "toothprep/step/core/units.h"

namespace toothprep {

ContactSet::ContactSet(std::size_t capacity, const PerTissue<GrindingProperties>& tissue,
                       bool trailing)
    : least_(trailing ? -std::numeric_limits<float>::infinity() : 0) {
  if (!std::all_of(tissue.begin(), tissue.end(),
                   [](const GrindingProperties& t) { return toothprep::is_linear(t); })) {
    nonlinear_.emplace(capacity, tissue);
    return;
  }
  for (int k = 0; k < kTissueCount; ++k) {
    const double ct = tissue[k].specific_energy / (2 * units::kPi);
    ct_[k] = static_cast<float>(ct);
    cn_[k] = static_cast<float>(ct / tissue[k].force_ratio);
  }
  const std::size_t by_fours = (capacity + 3) / 4 * 4;  // as they are read
  for (auto* array : {&nx_, &ny_, &nz_, &mx_, &my_, &mz_, &qx_, &qy_, &qz_, &torque_})
    array->resize(by_fours);
  area_.resize(by_fours);
  advances_.resize(by_fours / 4);
}

void ContactSet::Sums::add(const Element& e) noexcept {
  const float n[3] = {e.nx, e.ny, e.nz}, m[3] = {e.mx, e.my, e.mz};
  const float w = e.weight;
  for (int i = 0; i < 3; ++i) {
    feed[i] += w * e.tx * n[i];
    feed[3 + i] += w * e.ty * n[i];
    feed[12 + i] += w * e.arm * n[i];
    turn[i] += w * e.tx * m[i];
    turn[3 + i] += w * e.ty * m[i];
    turn[15 + i] += w * e.arm * m[i];
    for (int j = 0; j < 3; ++j) turn[6 + 3 * i + j] += w * n[i] * m[j];
  }
  const float square[6] = {n[0] * n[0], n[0] * n[1], n[0] * n[2],
                           n[1] * n[1], n[1] * n[2], n[2] * n[2]};
  for (int i = 0; i < 6; ++i) feed[6 + i] += w * square[i];
  feed[15] += e.area;
}

ContactSet::Sums ContactSet::sums_of(const FourElements& e, Float4 share, bool turns) noexcept {
  const Float4 w = share * e.weight, x = w * e.nx, y = w * e.ny, z = w * e.nz;
  const auto put_four = [](Float4 a, Float4 b, Float4 c, Float4 d, float* to) {
    transpose(a, b, c, d);
    store4((a + b) + (c + d), to);
  };
  Sums sums;
  float* const feed = sums.feed.data();
  put_four(e.tx * x, e.tx * y, e.tx * z, e.ty * x, feed);
  put_four(e.ty * y, e.ty * z, e.nx * x, e.nx * y, feed + 4);
  put_four(e.nx * z, e.ny * y, e.ny * z, e.nz * z, feed + 8);
  put_four(e.arm * x, e.arm * y, e.arm * z, e.arm * w, feed + 12);
  if (!turns) return sums;
  const Float4 mx = w * e.mx, my = w * e.my, mz = w * e.mz;
  float* const turn = sums.turn.data();
  put_four(e.tx * mx, e.tx * my, e.tx * mz, e.ty * mx, turn);
  put_four(e.ty * my, e.ty * mz, e.nx * mx, e.nx * my, turn + 4);
  put_four(e.nx * mz, e.ny * mx, e.ny * my, e.ny * mz, turn + 8);
  put_four(e.nz * mx, e.nz * my, e.nz * mz, e.arm * mx, turn + 12);
  put_four(e.arm * my, e.arm * mz, Float4{}, Float4{}, turn + 16);
  return sums;
}

void ContactSet::clear() noexcept {
  if (nonlinear_) nonlinear_->clear();
  if (advancing_ > 0) sums_ = {};
  count_ = advancing_ = 0;
  asked_.reset(), responded_.reset(), measured_.reset();
}

void ContactSet::add_advancing(const Sums& sums, int elements, int tissue, bool turns) noexcept {
  advancing_ += elements;
  Sums& to = sums_[tissue];
  for (std::size_t i = 0; i < to.feed.size(); ++i) to.feed[i] += sums.feed[i];
  if (!turns) return;
  for (std::size_t i = 0; i < to.turn.size(); ++i) to.turn[i] += sums.turn[i];
}

void ContactSet::add_advancing(const Sums* sums, const std::int32_t* places, int count,
                               int tissue) noexcept {
  advancing_ += count;
  float* const to = sums_[tissue].feed.data();
  Float4 a = load4(to), b = load4(to + 4), c = load4(to + 8), d = load4(to + 12);
  for (int k = 0; k < count; ++k) {
    const float* from = sums[places[k]].feed.data();
    a += load4(from), b += load4(from + 4), c += load4(from + 8), d += load4(from + 12);
  }
  store4(a, to), store4(b, to + 4), store4(c, to + 8), store4(d, to + 12);
}

namespace {

// The force per advance of sums, split along n_t and n_n: with v by columns, and with omega.
struct SplitForce {
  Mat3 tangential, normal;
  Vec3 torque;

  // From sums tx q, ty q, n q, r q for q = n_n.
  explicit SplitForce(const std::array<float, 16>& s) {
    tangential << s[0], s[1], s[2], s[3], s[4], s[5], 0, 0, 0;
    normal << s[6], s[7], s[8], s[7], s[9], s[10], s[8], s[10], s[11];
    torque << s[12], s[13], s[14];
  }
  // The same for q = r x n_n.
  explicit SplitForce(const std::array<float, 20>& s) {
    tangential << s[0], s[1], s[2], s[3], s[4], s[5], 0, 0, 0;
    normal << s[6], s[7], s[8], s[9], s[10], s[11], s[12], s[13], s[14];
    torque << s[15], s[16], s[17];
  }
};

}  // namespace

void ContactSet::add_sums(const Vec3& omega, GrindingResponse& r) const noexcept {
  r.set.count += advancing_;
  if (advancing_ == 0) return;
  const bool turns = omega.squaredNorm() > 0;
  for (int k = 0; k < kTissueCount; ++k) {
    if (sums_[k].feed[15] == 0) continue;
    const double t = ct_[k], n = cn_[k];
    const SplitForce feed(sums_[k].feed);
    r.B += t * feed.tangential - n * feed.normal;
    r.b += t * feed.torque;
    if (!turns) continue;
    const SplitForce turn(sums_[k].turn);
    r.f0 += (t * turn.tangential - n * turn.normal) * omega;
    r.t0 += t * turn.torque.dot(omega);
  }
}

void ContactSet::put(const Element& e, float t, float m) noexcept {
  const int n = count_++;
  nx_[n] = e.nx;
  ny_[n] = e.ny;
  nz_[n] = e.nz;
  mx_[n] = e.mx;
  my_[n] = e.my;
  mz_[n] = e.mz;
  t *= e.weight, m *= e.weight;
  qx_[n] = t * e.tx - m * e.nx;
  qy_[n] = t * e.ty - m * e.ny;
  qz_[n] = -m * e.nz;
  torque_[n] = t * e.arm;
}

void ContactSet::add(const Element& e, int tissue, float share) noexcept {
  if (nonlinear_) return nonlinear_->add(e, tissue, share);
  area_[count_] = {};
  area_[count_][tissue] = share * e.area;
  put(e, share * ct_[tissue], share * cn_[tissue]);
}

void ContactSet::add_four(const FourElements& e, int tissue, Float4 share,
                          float least_share) noexcept {
  const Float4 area = e.weight * e.arm;
  const Int4 counts = share > least_share;
  if (nonlinear_) {
    for (int p = 0; p < 4; ++p)
      if (counts[p])
        nonlinear_->add({e.nx[p], e.ny[p], e.nz[p], e.mx[p], e.my[p], e.mz[p], e.tx[p], e.ty[p],
                         e.weight[p], e.arm[p], area[p]},
                        tissue, share[p]);
    return;
  }
  const Float4 t = share * ct_[tissue] * e.weight, m = share * cn_[tissue] * e.weight;
  const Float4 values[10] = {
      e.nx,      e.ny,     e.nz, e.mx, e.my, e.mz, t * e.tx - m * e.nx, t * e.ty - m * e.ny,
      -m * e.nz, t * e.arm};
  float* const to[10] = {nx_.data(), ny_.data(), nz_.data(), mx_.data(), my_.data(),
                         mz_.data(), qx_.data(), qy_.data(), qz_.data(), torque_.data()};
  const Float4 covered = share * area;
  if (counts[0] & counts[1] & counts[2] & counts[3]) {
    for (int i = 0; i < 10; ++i) store4(values[i], to[i] + count_);
    for (int p = 0; p < 4; ++p) area_[count_ + p] = {}, area_[count_ + p][tissue] = covered[p];
    count_ += 4;
    return;
  }
  for (int p = 0; p < 4; ++p) {
    if (!counts[p]) continue;
    for (int i = 0; i < 10; ++i) to[i][count_] = values[i][p];
    area_[count_] = {};
    area_[count_++][tissue] = covered[p];
  }
}

GrindingResponse ContactSet::response(const Vec3& v, const Vec3& omega, double rotation_rate,
                                      LinearForm how) const noexcept {
  return nonlinear_ ? nonlinear_->response(v, omega, rotation_rate, how)
                    : linear_response(v, omega);
}

// The entries of a set, one array each.
struct ContactEntries {
  const float *nx, *ny, *nz, *mx, *my, *mz, *qx, *qy, *qz, *torque;
  int count;
  float least;
};

namespace {

// Which of them advance: a bit for each, by fours. Where the handle doesn't turn m isn't read: it would add nothing. Whether
// any is another than it was.
template <bool kTurns>
bool mark_advancing(const ContactEntries& e, const Eigen::Vector3f& v, const Eigen::Vector3f& o,
                    std::uint8_t* marks) {
  int changed = 0;
  for (int i = 0; i < e.count; i += 4) {
    Float4 s = load4(e.nx + i) * v.x() + load4(e.ny + i) * v.y() + load4(e.nz + i) * v.z();
    if constexpr (kTurns)
      s = s + load4(e.mx + i) * o.x() + load4(e.my + i) * o.y() + load4(e.mz + i) * o.z();
    const std::uint8_t bits = bits_of((s > e.least) & (Int4{0, 1, 2, 3} + i < e.count));
    changed |= bits ^ marks[i / 4];
    marks[i / 4] = bits;
  }
  return changed != 0;
}

// B and b of those that advance, added up in their order, and which these are.
GrindingResponse respond(const ContactEntries& e, const std::uint8_t* marks) {
  Float4 bx{}, by{}, bz{}, torque{};  // rows of B, and b
  Int4 count{}, places{};
  for (int i = 0; i < e.count; i += 4) {
    if (marks[i / 4] == 0) continue;
    const Int4 advances = lanes_of(marks[i / 4]);
    count -= advances;
    places += (Int4{0, 1, 2, 3} + i) & advances;
    Float4 nx = load4(e.nx + i), ny = load4(e.ny + i), nz = load4(e.nz + i), none{};
    Float4 qx = load4(e.qx + i), qy = load4(e.qy + i), qz = load4(e.qz + i),
           p = load4(e.torque + i);
    qx = advances ? qx : Float4{}, qy = advances ? qy : Float4{};
    qz = advances ? qz : Float4{}, p = advances ? p : Float4{};
    transpose(nx, ny, nz, none);
    for (int k = 0; k < 4; ++k) {
      const Float4 n = k == 0 ? nx : k == 1 ? ny : k == 2 ? nz : none;
      bx += qx[k] * n, by += qy[k] * n, bz += qz[k] * n, torque += p[k] * n;
    }
  }
  GrindingResponse r;
  r.B << bx[0], bx[1], bx[2], by[0], by[1], by[2], bz[0], bz[1], bz[2];
  r.b = Vec3(torque[0], torque[1], torque[2]);
  r.set = {count[0] + count[1] + count[2] + count[3],
           places[0] + places[1] + places[2] + places[3]};
  return r;
}

}  // namespace

ContactEntries ContactSet::entries(float least) const noexcept {
  return {nx_.data(), ny_.data(), nz_.data(), mx_.data(),     my_.data(), mz_.data(),
          qx_.data(), qy_.data(), qz_.data(), torque_.data(), count_,     least};
}

void ContactSet::note_advancing(const Vec3& v, const Vec3& omega, float least) const noexcept {
  const Question question{v, omega, least, count_};
  if (asked_ == question) return;
  const bool others = !asked_ || asked_->count != count_;
  asked_ = question;
  const ContactEntries e = entries(least);
  const Eigen::Vector3f vf = v.cast<float>(), of = omega.cast<float>();
  const bool changed = omega.squaredNorm() > 0 ? mark_advancing<true>(e, vf, of, advances_.data())
                                               : mark_advancing<false>(e, vf, of, advances_.data());
  if (others || changed) responded_.reset(), measured_.reset();
}

const GrindingResponse& ContactSet::response_of_entries(const Vec3& v,
                                                        const Vec3& omega) const noexcept {
  note_advancing(v, omega, least_);
  if (!responded_) responded_ = respond(entries(least_), advances_.data());
  return *responded_;
}

GrindingResponse ContactSet::linear_response(const Vec3& v, const Vec3& omega) const noexcept {
  GrindingResponse r = response_of_entries(v, omega);
  if (omega.squaredNorm() > 0) {
    const ContactEntries e = entries(least_);
    const Eigen::Vector3f vf = v.cast<float>(), of = omega.cast<float>();
    const float vx = vf.x(), vy = vf.y(), vz = vf.z(), ox = of.x(), oy = of.y(), oz = of.z();
    float f0 = 0, f1 = 0, f2 = 0, torque0 = 0;
#pragma omp simd reduction(+ : f0, f1, f2, torque0)
    for (int i = 0; i < e.count; ++i) {
      const float turn = e.mx[i] * ox + e.my[i] * oy + e.mz[i] * oz;
      const float s = e.nx[i] * vx + e.ny[i] * vy + e.nz[i] * vz + turn;
      const float w = s > e.least ? turn : 0;
      f0 += w * e.qx[i], f1 += w * e.qy[i], f2 += w * e.qz[i];
      torque0 += w * e.torque[i];
    }
    r.f0 = Vec3(f0, f1, f2);
    r.t0 = torque0;
  }
  add_sums(omega, r);
  return r;
}

AdvancingSet ContactSet::advancing_set(const Vec3& v, const Vec3& omega) const noexcept {
  AdvancingSet set = response_of_entries(v, omega).set;
  set.count += advancing_;
  return set;
}

PerTissue<double> ContactSet::advancing_area(const Vec3& v, const Vec3& omega) const noexcept {
  if (nonlinear_) return nonlinear_->advancing_area(v, omega);
  static_assert(kTissueCount == 4);
  note_advancing(v, omega, 0);
  if (!measured_) {
    Float4 sum{};
    for (int i = 0; i < count_; i += 4) {
      if (advances_[i / 4] == 0) continue;
      const Int4 advances = lanes_of(advances_[i / 4]);
      for (int k = 0; k < 4; ++k) {
        const Int4 counts = Int4{} + advances[k];
        sum += counts ? load4(area_[i + k].data()) : Float4{};
      }
    }
    measured_.emplace();
    store4(sum, measured_->data());
  }
  PerTissue<double> area{};
  for (int k = 0; k < kTissueCount; ++k) area[k] = (*measured_)[k] + sums_[k].feed[15];
  return area;
}

PerTissue<TissueBasis> ContactSet::basis(const Vec3& v, const Vec3& omega) const noexcept {
  PerTissue<TissueBasis> sum{};
  const Eigen::Vector3f vf = v.cast<float>(), of = omega.cast<float>();
  for (int i = 0; i < count_; ++i) {
    // In single precision, as response() does, so that both take the same elements.
    const float s = nx_[i] * vf.x() + ny_[i] * vf.y() + nz_[i] * vf.z() + mx_[i] * of.x() +
                    my_[i] * of.y() + mz_[i] * of.z();
    if (!(s > least_)) continue;
    const Vec3 n(nx_[i], ny_[i], nz_[i]), q(qx_[i], qy_[i], qz_[i]);
    const double advance = n.dot(v) + Vec3(mx_[i], my_[i], mz_[i]).dot(omega);
    const Vec3 normal = q.dot(n) / n.squaredNorm() * advance * n;
    const Vec3 tangential = q * advance - normal;
    double area = 0;
    for (const float a : area_[i]) area += a;
    if (!(area > 0)) continue;
    for (int k = 0; k < kTissueCount; ++k) {
      const double share = area_[i][k] / area;
      if (share == 0) continue;
      sum[k].tangential += share * tangential;
      sum[k].normal += share * normal;
      sum[k].torque += share * advance * torque_[i];
    }
  }
  for (int k = 0; k < kTissueCount; ++k) {
    if (sums_[k].feed[15] == 0) continue;
    const SplitForce feed(sums_[k].feed), turn(sums_[k].turn);
    sum[k].tangential += ct_[k] * (feed.tangential * v + turn.tangential * omega);
    sum[k].normal -= cn_[k] * (feed.normal * v + turn.normal * omega);
    sum[k].torque += ct_[k] * (feed.torque.dot(v) + turn.torque.dot(omega));
  }
  return sum;
}

bool ContactSet::any_advances(const Vec3& v, const Vec3& omega) const noexcept {
  const PerTissue<double> area = advancing_area(v, omega);
  return std::any_of(area.begin(), area.end(), [](double a) { return a > 0; });
}

}  // namespace toothprep
