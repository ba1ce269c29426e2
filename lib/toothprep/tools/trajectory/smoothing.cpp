#include "toothprep/tools/trajectory/smoothing.h"

#include <algorithm>
#include <cmath>

#include "toothprep/step/core/statistics.h"

namespace toothprep {
namespace {

// The weights of the value at the middle of a quadratic fitted to 2 m + 1 equal steps.
std::vector<double> weights(int m) {
  std::vector<double> w;
  const double n = 2.0 * m + 1;
  for (int i = -m; i <= m; ++i)
    w.push_back((3.0 * (3.0 * m * m + 3.0 * m - 1 - 5.0 * i * i)) /
                (n * (4.0 * m * m + 4.0 * m - 3)));
  return w;
}

}  // namespace

std::vector<Vec3> smoothed(const std::vector<Vec3>& values, int half) {
  std::vector<Vec3> result = values;
  if (half < 2) return result;
  const auto n = static_cast<int>(values.size());
  const std::vector<double> full = weights(half);
  for (int i = 0; i < n; ++i) {
    const int m = std::min({half, i, n - 1 - i});
    if (m < 2) continue;
    const std::vector<double> own = m == half ? std::vector<double>() : weights(m);
    const std::vector<double>& w = m == half ? full : own;
    // About the middle value, so that what stands still stays to the bit.
    const Vec3& middle = values[static_cast<std::size_t>(i)];
    Vec3 sum = Vec3::Zero();
    for (int j = -m; j <= m; ++j)
      sum +=
          w[static_cast<std::size_t>(j + m)] * (values[static_cast<std::size_t>(i + j)] - middle);
    result[static_cast<std::size_t>(i)] = middle + sum;
  }
  return result;
}

std::vector<HandleSample> smoothed(const std::vector<HandleSample>& path, double window) {
  std::vector<HandleSample> result = path;
  if (path.size() < 5) return result;
  const double step = path[1].time - path[0].time;
  const auto half = static_cast<int>(std::floor(window / step / 2 + 1e-9));
  if (half < 2) return result;
  std::vector<Vec3> position, axis;
  std::vector<Vec3> real;
  Quat last = path.front().pose.orientation;
  for (const HandleSample& s : path) {
    Quat q = s.pose.orientation;
    if (q.dot(last) < 0) q.coeffs() = -q.coeffs();  // the same turn, next to the last
    last = q;
    position.push_back(s.pose.position);
    axis.push_back(q.vec());
    real.emplace_back(q.w(), 0, 0);
  }
  position = smoothed(position, half);
  axis = smoothed(axis, half);
  real = smoothed(real, half);
  for (std::size_t i = 0; i < result.size(); ++i) {
    result[i].pose.position = position[i];
    const Quat q(real[i].x(), axis[i].x(), axis[i].y(), axis[i].z());
    if (std::abs(q.norm() - 1) > 1e-12) result[i].pose.orientation = q.normalized();
  }
  return result;
}

VelocityNoise velocity_noise(const std::vector<HandleSample>& path) {
  VelocityNoise result;
  if (path.size() < 100) return result;
  const double step = path[1].time - path[0].time;
  std::vector<Vec3> velocity;
  for (std::size_t i = 1; i < path.size(); ++i)
    velocity.push_back((path[i].pose.position - path[i - 1].pose.position) / step);
  // The mean over 50 ms: running sums.
  const auto half = std::max<std::ptrdiff_t>(2, static_cast<std::ptrdiff_t>(0.025 / step));
  const auto n = static_cast<std::ptrdiff_t>(velocity.size());
  std::vector<double> speed, spans;
  const auto span = std::max<std::ptrdiff_t>(20, static_cast<std::ptrdiff_t>(0.25 / step));
  double square = 0;
  for (std::ptrdiff_t i = half; i + half < n; ++i) {
    const Vec3 mean = (path[static_cast<std::size_t>(i + half + 1)].pose.position -
                       path[static_cast<std::size_t>(i - half)].pose.position) /
                      (step * static_cast<double>(2 * half + 1));
    square += (velocity[static_cast<std::size_t>(i)] - mean).squaredNorm();
    if (mean.norm() > 0) speed.push_back(mean.norm());
    if ((i - half + 1) % span == 0) {
      spans.push_back(std::sqrt(square / static_cast<double>(span)));
      square = 0;
    }
  }
  if (!spans.empty()) result.noise = median(std::move(spans));
  if (!speed.empty()) result.feed = median(std::move(speed));
  return result;
}

}  // namespace toothprep
