#include "toothprep/tools/display/display_surface.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <exception>

#include "toothprep/step/core/errors.h"

namespace toothprep {
namespace {

double seconds(BrickFeed::Clock::duration d) { return std::chrono::duration<double>(d).count(); }

const DisplayOptions& checked(const DisplayOptions& options) {
  if (!(options.rate > 0 && options.rate <= 1000))
    throw Error("display: the rate must lie in (0, 1000] Hz, got " + std::to_string(options.rate));
  return options;
}

}  // namespace

DisplaySurface::DisplaySurface(Workpiece& workpiece, const DisplayOptions& options)
    : tooth_(workpiece.tooth()),
      options_(checked(options)),
      feed_(workpiece, options.feed),
      cut_(workpiece.cut()),
      range_(blocks_of(cut_)),
      dirty_(range_.size(), 0),
      blocks_(range_.size()) {
  extract_all();
}

DisplaySurface::~DisplaySurface() { stop(); }

void DisplaySurface::extract_all() {
  const Clock::time_point begin = Clock::now();
  tbb::enumerable_thread_specific<BlockMesher> meshers;
  tbb::parallel_for(std::size_t{0}, blocks_.size(), [&](std::size_t b) {
    BlockMesh mesh = meshers.local().mesh(tooth_, cut_, range_.block(b));
    if (mesh.mesh.triangles.empty()) return;
    mesh.generation = 1;
    blocks_[b] = std::make_shared<const BlockMesh>(std::move(mesh));
  });
  generation_ = 1;
  counts_.first_extraction = seconds(Clock::now() - begin);
}

// Takes one brick over into the worker's cut and finds which blocks it changes.
void DisplaySurface::apply(const BrickFeed::Change& change) {
  const std::size_t b = change.brick;
  const float* solid = tooth_.solid.brick(b);
  const float* before = cut_.brick(b);
  const float* after = change.values.data();
  const int step = change.uniform ? 0 : 1;
  // The box of the voxels where what remains has changed.
  Index3 low = Index3::Constant(kBrickEdge), high = Index3::Constant(-1);
  for (int v = 0; v < kBrickVoxels; ++v) {
    if (std::max(solid[v], before[v]) == std::max(solid[v], after[step * v])) continue;
    const Index3 at(v >> 6, (v >> 3) & 7, v & 7);
    low = low.cwiseMin(at);
    high = high.cwiseMax(at);
  }
  if (change.uniform) {
    cut_.set_uniform(b, after[0]);
  } else {
    std::copy(after, after + kBrickVoxels, cut_.writable_brick(b));
  }
  if (high.x() < 0) return;  // nothing to be seen
  changed_.push_back(change.changed);
  const Index3 origin = cut_.brick_origin(b);
  const BlockRange touched = blocks_touched(range_, origin + low, origin + high);
  for (std::size_t i = 0; i < touched.size(); ++i) {
    const std::size_t block = range_.index(touched.block(i));
    if (dirty_[block]) continue;
    dirty_[block] = 1;
    to_mesh_.push_back(block);
  }
}

bool DisplaySurface::pass() {
  const Clock::time_point begin = Clock::now();
  feed_.receive([this](const BrickFeed::Change& change) { apply(change); });

  std::sort(to_mesh_.begin(), to_mesh_.end());
  const std::uint64_t generation = generation_ + 1;  // written by passes only
  std::vector<std::shared_ptr<const BlockMesh>> fresh;
  fresh.reserve(to_mesh_.size());
  for (const std::size_t block : to_mesh_) {
    BlockMesh mesh = mesher_.mesh(tooth_, cut_, range_.block(block));
    mesh.generation = generation;
    fresh.push_back(std::make_shared<const BlockMesh>(std::move(mesh)));
  }

  {
    const std::lock_guard lock(published_);
    ++counts_.passes;
    if (!fresh.empty()) {
      // Swapped, so that what is replaced goes away after the lock.
      for (std::size_t i = 0; i < fresh.size(); ++i) std::swap(blocks_[to_mesh_[i]], fresh[i]);
      generation_ = generation;
      ++counts_.publications;
      counts_.blocks += fresh.size();
      const Clock::time_point now = Clock::now();
      pass_time_.add(seconds(now - begin));
      for (const Clock::time_point& changed : changed_) latency_.add(seconds(now - changed));
    }
  }
  const bool published = !fresh.empty();
  for (const std::size_t block : to_mesh_) dirty_[block] = 0;
  to_mesh_.clear();
  changed_.clear();
  return published;
}

void DisplaySurface::start() {
  if (worker_.joinable()) return;
  worker_ = std::jthread([this](const std::stop_token& stop) { work(stop); });
}

void DisplaySurface::stop() {
  if (!worker_.joinable()) return;
  worker_.request_stop();
  worker_.join();
  worker_ = {};
}

void DisplaySurface::work(const std::stop_token& stop) {
  const auto period =
      std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1 / options_.rate));
  Clock::time_point due = Clock::now(), last{};
  try {
    while (!stop.stop_requested()) {
      const Clock::time_point now = Clock::now();
      if (last != Clock::time_point{}) {
        const std::lock_guard lock(published_);
        ++gaps_;
        gap_seconds_ += seconds(now - last);
        counts_.longest_gap = std::max(counts_.longest_gap, seconds(now - last));
      }
      last = now;
      pass();
      due += period;
      if (due < Clock::now()) due = Clock::now();  // late: not in a burst afterwards
      std::unique_lock lock(sleeping_);
      wake_.wait_until(lock, stop, due, [] { return false; });
    }
  } catch (const std::exception& e) {
    const std::lock_guard lock(published_);
    counts_.failure = e.what();
  }
}

void DisplaySurface::finish() {
  stop();
  bool all = false;
  while (!all) {
    all = feed_.hand_over_all();
    pass();
  }
}

DisplaySurface::Update DisplaySurface::blocks_since(std::uint64_t generation) const {
  const std::lock_guard lock(published_);
  Update update;
  update.generation = generation_;
  for (const auto& b : blocks_)
    if (b && b->generation > generation) update.blocks.push_back(b);
  return update;
}

DisplayMesh DisplaySurface::mesh() const { return join_blocks(blocks_since(0).blocks); }

DisplayStats DisplaySurface::stats() const {
  const std::lock_guard lock(published_);
  DisplayStats stats = counts_;
  stats.rate = gap_seconds_ > 0 ? gaps_ / gap_seconds_ : 0;
  stats.pass_median = pass_time_.quantile(0.5);
  stats.pass_99 = pass_time_.quantile(0.99);
  stats.pass_worst = pass_time_.largest();
  stats.latency_median = latency_.quantile(0.5);
  stats.latency_99 = latency_.quantile(0.99);
  stats.latency_worst = latency_.largest();
  stats.feed = feed_.counts();
  return stats;
}

}  // namespace toothprep
