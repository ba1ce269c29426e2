#include "toothprep/proof/reference/rise_in_layer.h"

#include "toothprep/step/core/errors.h"

namespace toothprep::reference {
namespace {

constexpr int kRows = 600;
constexpr double kTolerance = 1e-8;   // mm per step
constexpr double kLargestStep = 0.1;  // s

}  // namespace

double share_of_plateau(const Scene& scene, const Vec3& start, double depth, double speed,
                        double stiffness) {
  if (!(depth > 0) || !(speed > 0) || !(stiffness > 0) || !(start.y() > 0))
    throw Error("share of the plateau: depth, speed, stiffness and reach must be positive");
  Scene layer = scene;
  layer.block.enamel = layer.block.size.y();
  if (!(depth < layer.block.size.y()))
    throw Error("share of the plateau: the block must be deeper than the layer");
  const Vec3 velocity(0, -speed, 0);
  const Vec3 end = start - Vec3(0, depth, 0);
  const double plateau = load(layer, {end, Quat::Identity()}, velocity).force.norm();

  CoupledFeed feed;
  feed.handle = steady_handle(start, velocity);
  feed.stiffness = stiffness;
  feed.tolerance = kTolerance;
  feed.largest_step = kLargestStep;
  // The bur is behind the handle by less than plateau / k.
  const double time = (depth + plateau / stiffness) / speed;
  std::vector<double> times;
  for (int i = 0; i <= kRows; ++i) times.push_back(time * i / kRows);
  const CoupledResult solved = coupled_feed(layer, feed, times);
  for (std::size_t i = 1; i < solved.rows.size(); ++i) {
    const CoupledRow &a = solved.rows[i - 1], &b = solved.rows[i];
    if (b.position.y() > end.y()) continue;
    const double part = (a.position.y() - end.y()) / (a.position.y() - b.position.y());
    return (a.force.norm() + part * (b.force.norm() - a.force.norm())) / plateau;
  }
  throw Error("share of the plateau: the bur doesn't get through the layer");
}

}  // namespace toothprep::reference
