#include "toothprep/proof/reference/coupled_feed.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <boost/math/distributions/students_t.hpp>
#include <boost/math/tools/toms748_solve.hpp>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <unsupported/Eigen/MatrixFunctions>
#include <vector>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"

namespace toothprep::reference {
namespace {

using Vec9 = Eigen::Matrix<double, 9, 1>;
using Mat9 = Eigen::Matrix<double, 9, 9>;

constexpr int kNewtonPasses = 20;
constexpr int kPolish = 3;              // Newton passes for a row's velocity
constexpr double kDetermined = 1e-2;    // least singular value, relative, that determines it
constexpr double kSmallestStep = 1e-9;  // in tau, s^(1/3)

// Radau IIA, three stages.
const double kRoot6 = std::sqrt(6.0);
const std::array<double, 3> kNode = {(4 - kRoot6) / 10, (4 + kRoot6) / 10, 1};
const std::array<std::array<double, 3>, 3> kStage = {{
    {(88 - 7 * kRoot6) / 360, (296 - 169 * kRoot6) / 1800, (-2 + 3 * kRoot6) / 225},
    {(296 + 169 * kRoot6) / 1800, (88 + 7 * kRoot6) / 360, (-2 - 3 * kRoot6) / 225},
    {(16 - kRoot6) / 36, (16 + kRoot6) / 36, 1.0 / 9},
}};

// A point of the solution; rate W = dP/dtau = 3 tau² P'.
struct State {
  double tau = 0;
  Vec3 position = Vec3::Zero();
  Vec3 rate = Vec3::Zero();
  double torque = 0;  // N·mm
};

class Integrator {
 public:
  Integrator(const Scene& scene, const CoupledFeed& feed, double origin)
      : scene_(scene), feed_(feed), origin_(origin) {}

  double time(double tau) const { return origin_ + tau * tau * tau; }
  double tau(double time) const { return std::cbrt(std::max(0.0, time - origin_)); }
  static double clock(double tau) { return 3 * tau * tau; }  // dt / dtau

  std::vector<int> shape(const State& s) const {
    return contact_shape(scene_, {s.position, feed_.orientation}, s.rate);
  }

  Engagement engaged(const Vec3& position, const Vec3& direction) const {
    return engagement(scene_, {position, feed_.orientation}, direction);
  }

  // One step of h. The equation times dt/dtau, homogeneous in W:
  //   clock (k (P_H - P) + b v_H) - b W + F(P, W) = 0 at the three stages.
  // Nothing if Newton doesn't converge.
  std::optional<State> step(const State& from, double h) const {
    std::array<HandleMotion, 3> handle;
    std::array<double, 3> speed;
    std::array<Vec3, 3> rate;
    for (std::size_t i = 0; i < 3; ++i) {
      const double at = from.tau + kNode[i] * h;
      handle[i] = feed_.handle(time(at));
      speed[i] = clock(at);
      rate[i] = from.rate.squaredNorm() > 0 ? from.rate : Vec3(speed[i] * handle[i].velocity);
      if (!(rate[i].squaredNorm() > 0)) rate[i] = handle[i].position - from.position;
    }
    const Mat3 slope = position_slope(from.position + h * rate[2], rate[2]);

    double last = std::numeric_limits<double>::infinity();
    for (int pass = 0; pass < kNewtonPasses; ++pass) {
      Vec9 miss;
      Mat9 jacobian;
      Engagement end;
      for (std::size_t i = 0; i < 3; ++i) {
        Vec3 position = from.position;
        for (std::size_t j = 0; j < 3; ++j) position += h * kStage[i][j] * rate[j];
        const Engagement e = engaged(position, rate[i]);
        const auto row = static_cast<Eigen::Index>(3 * i);
        miss.segment<3>(row) = speed[i] * (feed_.stiffness * (handle[i].position - position) +
                                           feed_.damping * handle[i].velocity) -
                               feed_.damping * rate[i] + e.drag * rate[i];
        for (std::size_t j = 0; j < 3; ++j) {
          const auto column = static_cast<Eigen::Index>(3 * j);
          jacobian.block<3, 3>(row, column) =
              h * kStage[i][j] * (slope - speed[i] * feed_.stiffness * Mat3::Identity());
          if (i == j)
            jacobian.block<3, 3>(row, column) += e.drag - feed_.damping * Mat3::Identity();
        }
        if (i == 2) end = e;
      }
      const Vec9 change = jacobian.partialPivLu().solve(-miss);
      if (!change.allFinite()) return std::nullopt;
      for (std::size_t i = 0; i < 3; ++i)
        rate[i] += change.segment<3>(static_cast<Eigen::Index>(3 * i));
      // Converged, or as near as the quadrature's own rounding permits.
      const double moved = h * change.cwiseAbs().maxCoeff();
      const bool stuck = pass > 3 && moved > 0.5 * last && moved < 0.1 * feed_.tolerance;
      if (moved < 1e-4 * feed_.tolerance || stuck) {
        State to;
        to.tau = from.tau + h;
        to.position = from.position;
        for (std::size_t j = 0; j < 3; ++j) to.position += h * kStage[2][j] * rate[j];
        to.rate = rate[2];
        to.torque = end.torque.dot(to.rate) / speed[2];
        return to;
      }
      last = moved;
    }
    return std::nullopt;
  }

 private:
  // dF(P, W)/dP by differences: it only speeds Newton up.
  Mat3 position_slope(const Vec3& position, const Vec3& rate) const {
    constexpr double kDelta = 1e-7;  // mm
    Mat3 slope = Mat3::Zero();
    const Vec3 here = engaged(position, rate).drag * rate;
    for (int a = 0; a < 3; ++a)
      slope.col(a) = (engaged(position + kDelta * Vec3::Unit(a), rate).drag * rate - here) / kDelta;
    return slope;
  }

  const Scene& scene_;
  const CoupledFeed& feed_;
  double origin_;
};

void require_coupled(bool good, const std::string& condition) {
  if (!good) throw Error("coupled reference: " + condition);
}

double grinding_area(const Scene& scene, const Pose& bur, const Vec3& velocity) {
  const Engagement e = engagement(scene, bur, velocity);
  return e.area[0] + e.area[1];
}

// The last time, to 1e-14 s, at which the bur on the handle doesn't touch yet; nothing if it never
// does.
std::optional<double> first_contact(const Scene& scene, const CoupledFeed& feed, double from,
                                    double to) {
  const auto touches = [&](double t) {
    const HandleMotion h = feed.handle(t);
    return grinding_area(scene, {h.position, feed.orientation}, h.velocity) > 0;
  };
  if (touches(from)) return from;
  double before = from;
  while (before < to) {
    double after = std::min(to, before + feed.largest_step);
    if (touches(after)) {
      while (after - before > 1e-14 * std::max(1.0, std::abs(after))) {
        const double middle = (before + after) / 2;
        if (!(middle > before && middle < after)) break;
        (touches(middle) ? after : before) = middle;
      }
      return before;
    }
    before = after;
  }
  return std::nullopt;
}

// The quintic through positions and rates at the ends and the middle of one accepted step.
State between(const State& a, const State& m, const State& b, double tau) {
  const double h = (b.tau - a.tau) / 2, x = (tau - m.tau) / h;  // -1 .. 1
  // p(x) = m + m' x + c2 x² + ... + c5 x^5 with p and p' given at -1 and 1.
  const Vec3 rate = h * m.rate;
  const Vec3 even = (b.position + a.position) / 2 - m.position;  // c2 + c4
  const Vec3 odd = (b.position - a.position) / 2 - rate;         // c3 + c5
  const Vec3 even_slope = h * (b.rate - a.rate) / 2;             // 2 c2 + 4 c4
  const Vec3 odd_slope = h * (b.rate + a.rate) / 2 - rate;       // 3 c3 + 5 c5
  const Vec3 c4 = even_slope / 2 - even, c2 = even - c4;
  const Vec3 c5 = (odd_slope - 3 * odd) / 2, c3 = odd - c5;
  State out;
  out.tau = tau;
  out.position = m.position + x * (rate + x * (c2 + x * (c3 + x * (c4 + x * c5))));
  out.rate = (rate + x * (2 * c2 + x * (3 * c3 + x * (4 * c4 + x * 5 * c5)))) / h;
  return out;
}

// Where, within the solved step, the contact first isn't what it was at the step's start:
// the load has a kink there, and a step across it may be worse than its error estimate knows.
// Nothing if it is the same at the end, or if that is within kSmallestStep of the ends.
std::optional<double> kink_in(const Integrator& solver, const State& from, const State& middle,
                              const State& end) {
  if (from.tau == 0) return std::nullopt;  // the first touch has its own change of variable
  const std::vector<int> shape = solver.shape(from);
  if (solver.shape(end) == shape) return std::nullopt;
  double before = from.tau, after = end.tau;
  while (after - before > 0.01 * kSmallestStep) {
    const double half = (before + after) / 2;
    (solver.shape(between(from, middle, end, half)) == shape ? before : after) = half;
  }
  if (before - from.tau < kSmallestStep || end.tau - before < kSmallestStep) return std::nullopt;
  return before;
}

// All states from the first touch to `until`, in triples that share ends: start, middle and end of
// each step. Sets stall, break_through and steps of the result.
std::vector<State> integrate(const Scene& scene, const CoupledFeed& feed, const Integrator& solver,
                             double until, CoupledResult& result) {
  std::vector<double> stops = feed.handle_breaks;
  std::erase_if(stops, [&](double t) { return !(t > *result.contact && t < until); });
  stops.push_back(until);
  std::sort(stops.begin(), stops.end());

  std::vector<State> states(1);
  states[0].position = feed.handle(*result.contact).position;
  double next = 1e-2;  // in tau: a microsecond
  for (const double stop_time : stops) {
    const double stop = solver.tau(stop_time);
    while (stop - states.back().tau > kSmallestStep) {
      const State from = states.back();
      const double cap = std::cbrt(from.tau * from.tau * from.tau + feed.largest_step) - from.tau;
      const double room = stop - from.tau;
      double h = std::min({next, cap, room});
      if (h < room && h > 0.6 * room) h = room / 2;
      const std::optional<State> whole = solver.step(from, h);
      std::optional<State> middle, end;
      if (whole) middle = solver.step(from, h / 2);
      if (middle) end = solver.step(*middle, h / 2);
      const double error = end ? (end->position - whole->position).cwiseAbs().maxCoeff()
                               : std::numeric_limits<double>::infinity();
      // Fifth order: the error of a step goes with h^6.
      const double change = 0.9 * std::pow(feed.tolerance / std::max(error, 1e-300), 1.0 / 6);
      if (!(error <= feed.tolerance)) {
        if (h <= 2 * kSmallestStep) {
          const double now = solver.time(from.tau);
          const HandleMotion handle = feed.handle(now);
          require_coupled(
              grinding_area(scene, {handle.position, feed.orientation}, handle.velocity) == 0,
              fmt::format("no solution from {:g} s on: the bur runs away from what held it, "
                          "into more tissue",
                          now));
          result.break_through = now;
          return states;
        }
        next = h * std::clamp(change, 0.1, 0.7);
        continue;
      }
      next = h * std::clamp(change, 0.3, 3.0);
      ++result.steps;
      // Twice, since the first time the kink is sought on a curve that it has spoilt a little.
      for (int pass = 0; pass < 2; ++pass) {
        const auto kink = kink_in(solver, from, *middle, *end);
        if (!kink) break;
        h = *kink - from.tau;
        middle = solver.step(from, h / 2);
        if (middle) end = solver.step(*middle, h / 2);
        require_coupled(middle && end, "no solution just before the contact changes its shape");
      }

      const bool stalls = middle->torque >= feed.stall_torque || end->torque >= feed.stall_torque;
      if (stalls) {
        // The step that ends where the torque is reached, again in two halves.
        const auto excess = [&](double part) {
          if (part <= 0) return from.torque - feed.stall_torque;
          middle = solver.step(from, part / 2);
          if (middle) end = solver.step(*middle, part / 2);
          require_coupled(middle && end, "no solution just before the stall");
          return end->torque - feed.stall_torque;
        };
        const double latest = middle->torque >= feed.stall_torque ? h / 2 : h;
        std::uintmax_t calls = 80;
        const auto root = boost::math::tools::toms748_solve(
            excess, 0.0, latest, boost::math::tools::eps_tolerance<double>(46), calls);
        excess(root.second);
        const HandleMotion handle = feed.handle(solver.time(end->tau));
        const Vec3 velocity = end->rate / Integrator::clock(end->tau);
        result.stall = StallEvent{solver.time(end->tau), end->position, velocity,
                                  -feed.stiffness * (handle.position - end->position) -
                                      feed.damping * (handle.velocity - velocity)};
      }
      states.push_back(*middle);
      states.push_back(*end);
      if (stalls) return states;
    }
  }
  return states;
}

// A row in contact out of the solved states. Returns the rest of the equation of motion there, N.
double fill_row(const CoupledFeed& feed, const Integrator& solver, const std::vector<State>& states,
                const HandleMotion& handle, CoupledRow& row) {
  const double tau = solver.tau(row.time);
  const auto after = std::lower_bound(states.begin() + 1, states.end() - 1, tau,
                                      [](const State& s, double t) { return s.tau < t; });
  const std::size_t cell = static_cast<std::size_t>(after - states.begin() - 1) / 2 * 2;
  const State s = between(states[cell], states[cell + 1], states[cell + 2], tau);
  row.position = s.position;
  row.velocity = s.rate / Integrator::clock(tau);
  const Vec3 spring = feed.stiffness * (handle.position - row.position);

  // The velocity that the position demands, where the drag determines it: an interpolated one is
  // less accurate within a step that passes a tissue's border.
  Engagement e = solver.engaged(row.position, row.velocity);
  Vec3 miss = Vec3::Zero();
  for (int pass = 0;; ++pass) {
    miss = spring + feed.damping * (handle.velocity - row.velocity) + e.drag * row.velocity;
    if (pass == kPolish || miss.norm() < 1e-11) break;
    Eigen::JacobiSVD<Mat3> svd(e.drag - feed.damping * Mat3::Identity(),
                               Eigen::ComputeFullU | Eigen::ComputeFullV);
    svd.setThreshold(kDetermined);
    const Vec3 change = svd.solve(-miss);
    if (!(change.norm() < 0.1 * row.velocity.norm())) break;
    row.velocity += change;
    e = solver.engaged(row.position, row.velocity);
  }
  const Load l = load(e, row.velocity);
  row.force = -spring - feed.damping * (handle.velocity - row.velocity);
  row.torque = l.torque;
  row.area = l.area;
  return miss.norm();
}

}  // namespace

Handle steady_handle(const Vec3& start, const Vec3& velocity) {
  return [=](double t) { return HandleMotion{start + t * velocity, velocity}; };
}
Handle ramped_handle(const Vec3& start, const Vec3& acceleration) {
  return [=](double t) { return HandleMotion{start + t * t / 2 * acceleration, t * acceleration}; };
}

CoupledResult coupled_feed(const Scene& scene, const CoupledFeed& feed,
                           const std::vector<double>& times) {
  require_coupled(static_cast<bool>(feed.handle), "there is no handle motion");
  require_coupled(feed.stiffness > 0 && std::isfinite(feed.stiffness),
                  "the stiffness must be positive and finite");
  require_coupled(feed.damping >= 0 && std::isfinite(feed.damping),
                  "the damping must be finite and not negative");
  require_coupled(feed.stall_torque > 0, "the stall torque must be positive");
  require_coupled(feed.tolerance > 0 && feed.largest_step > 0,
                  "tolerance and largest step must be positive");
  for (std::size_t i = 0; i < times.size(); ++i)
    require_coupled(std::isfinite(times[i]) && (i == 0 || times[i] > times[i - 1]),
                    "times must be finite and increasing");
  CoupledResult result;
  if (times.empty()) return result;

  result.contact = first_contact(scene, feed, times.front(), times.back());
  const double origin = result.contact.value_or(times.back());
  const Integrator solver(scene, feed, origin);
  std::vector<State> states;
  if (result.contact) states = integrate(scene, feed, solver, times.back(), result);

  result.rows.resize(times.size());
  std::vector<double> rest(times.size(), 0.0);
  tbb::parallel_for(std::size_t{0}, times.size(), [&](std::size_t i) {
    CoupledRow& row = result.rows[i];
    row.time = times[i];
    const HandleMotion handle = feed.handle(row.time);
    row.position = handle.position;
    row.velocity = handle.velocity;
    if (result.stall && row.time >= result.stall->time) {
      row.stalled = true;
      row.position = result.stall->position;
      row.velocity = Vec3::Zero();
      row.force = -stalled_force(feed, row.position, row.time);
      row.torque = feed.stall_torque;
    } else if (result.contact && row.time > origin && states.size() > 1 &&
               !(result.break_through && row.time >= *result.break_through)) {
      rest[i] = fill_row(feed, solver, states, handle, row);
    } else if (result.contact && row.time == origin) {
      row.velocity = Vec3::Zero();  // in contact, without a force yet
    }
  });
  for (const double r : rest) result.largest_residual = std::max(result.largest_residual, r);
  return result;
}

Vec3 stalled_force(const CoupledFeed& feed, const Vec3& stalled_position, double time) {
  const HandleMotion handle = feed.handle(time);
  return feed.stiffness * (handle.position - stalled_position) + feed.damping * handle.velocity;
}

Eigen::VectorXd constant_drag_force(const Eigen::MatrixXd& drag, double stiffness,
                                    const Eigen::VectorXd& handle_velocity, double time) {
  require_coupled(
      drag.rows() == drag.cols() && drag.rows() == handle_velocity.size() && drag.rows() > 0,
      "drag and velocity must have the same dimension");
  require_coupled(stiffness > 0 && time >= 0, "stiffness must be positive, time not negative");
  const Eigen::FullPivLU<Eigen::MatrixXd> lu(drag);
  require_coupled(lu.isInvertible(), "a constant drag must be invertible");
  const Eigen::MatrixXd decay = (stiffness * time * lu.inverse()).exp();
  return (decay - Eigen::MatrixXd::Identity(drag.rows(), drag.cols())) * drag * handle_velocity;
}

double stale_depth(const Scene& scene, const Bur& bur, const CoupledFeed& feed,
                   const std::vector<CoupledRow>& rows, std::size_t stride) {
  constexpr int kAlong = 5, kAround = 24;
  const Vec3 half = scene.block.size / 2;
  const Mat3 to_world = feed.orientation.toRotationMatrix();
  stride = std::max<std::size_t>(stride, 1);
  double deepest = 0;
  for (std::size_t now = 0; now < rows.size(); now += stride) {
    if (rows[now].stalled) break;
    for (const ProfilePiece& piece : bur.profile()) {
      if (!piece.grinds) continue;
      for (int n = 0; n < kAlong * kAround; ++n) {
        const int along = n / kAround;
        const ProfilePoint p = point_on(piece, (along + 0.5) / kAlong);
        const double phi = 2 * units::kPi * (n % kAround + 0.5) / kAround;
        const Vec3 radial(std::cos(phi), std::sin(phi), 0);
        const Vec3 normal = to_world * (p.along_z * radial - p.along_r * Vec3::UnitZ());
        if (!(normal.dot(rows[now].velocity) > 1e-9 * rows[now].velocity.norm())) continue;
        const Vec3 x = rows[now].position + to_world * (p.r * radial + p.z * Vec3::UnitZ());
        if (std::abs(x.x()) > half.x() || x.y() > 0 || x.y() < -scene.block.size.y() ||
            std::abs(x.z()) > half.z())
          continue;
        for (std::size_t then = 0; then < now; then += stride) {
          const Vec3 b = to_world.transpose() * (x - rows[then].position);
          deepest = std::max(deepest, -bur.distance(b.head<2>().norm(), b.z()));
        }
      }
    }
  }
  return deepest;
}

}  // namespace toothprep::reference
