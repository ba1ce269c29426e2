#include "toothprep/tools/view/live_scene.h"

#include <chrono>
#include <mutex>

#include "toothprep/tools/view/newest.h"
#include "toothprep/tools/view/page_assets.h"
#include "toothprep/tools/view/scene_facts.h"
#include "toothprep/tools/view/tissue_volume.h"
#include "toothprep/tools/view/wire.h"

namespace toothprep {
namespace {

using Clock = std::chrono::steady_clock;

constexpr auto kSurfacePeriod = std::chrono::milliseconds(33);

// The kinds of messages: int32, then
enum Message : std::int32_t {
  kRow = 1,  // int32 0, float64 time of the session (s) and of the world (ms since 1970), columns
  kBlocks = 2,  // as BlockBytes
};

double world_ms() {
  return std::chrono::duration<double, std::milli>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

}  // namespace

struct LiveScene::Work {
  struct Moment {
    LiveTick tick;
    std::int64_t missed = 0;  // ticks so far
    double world_ms = 0;      // when it was taken, ms since 1970: as the page's clock counts
  };
  std::string facts;
  TissueVolume volume;
  Newest<Moment> newest;
  std::int64_t missed = 0;  // the servo thread's

  // The server thread's.
  Moment moment;
  std::uint64_t moments = 0;  // that were read
  void read_newest() {
    if (newest.read(moment)) ++moments;
  }

  std::mutex guard;  // of what follows
  const DisplaySurface* display = nullptr;
};

class LiveScene::Feed final : public PageFeed {
 public:
  explicit Feed(Work& work) : work_(work) {}

  std::string next() override {
    if (Clock::now() >= surface_due_)
      if (std::string blocks = new_blocks(); !blocks.empty()) return blocks;
    work_.read_newest();
    if (work_.moments == seen_moments_) return {};
    seen_moments_ = work_.moments;
    const Work::Moment& m = work_.moment;
    std::string bytes;
    append_bytes(kRow, bytes);
    append_bytes(std::int32_t{0}, bytes);
    append_bytes(m.tick.row.handle.time, bytes);
    append_bytes(m.world_ms, bytes);
    append_row({&m.tick.row, m.tick.flags, m.tick.fault, m.missed}, bytes);
    return bytes;
  }

 private:
  std::string new_blocks() {
    surface_due_ = Clock::now() + kSurfacePeriod;
    DisplaySurface::Update update;
    {
      const std::lock_guard lock(work_.guard);
      if (work_.display) update = work_.display->blocks_since(generation_);
    }
    if (update.blocks.empty()) return {};
    generation_ = update.generation;
    BlockBytes blocks(static_cast<std::int32_t>(generation_));
    for (const auto& block : update.blocks) blocks.add(*block);
    std::string bytes;
    append_bytes(kBlocks, bytes);
    return bytes + blocks.take();
  }

  Work& work_;
  std::uint64_t generation_ = 0, seen_moments_ = 0;
  Clock::time_point surface_due_{};
};

LiveScene::LiveScene(const Bur& bur, const LayeredTooth& tooth, const Parameters& parameters,
                     const std::string& name, const std::string& version)
    : work_(std::make_unique<Work>()) {
  work_->volume = tissue_volume(tooth);
  SceneFacts facts;
  facts.kind = SceneKind::kLive;
  facts.version = version;
  facts.layers = {name};
  facts.bounds = bounds_of_solid(tooth);
  facts.provenance = tooth.provenance;
  facts.bur = &bur;
  facts.parameters = &parameters;
  facts.session = true;
  facts.volume = &work_->volume;
  work_->facts = scene_json(facts);
}

LiveScene::~LiveScene() = default;

void LiveScene::begin(const DisplaySurface& display) {
  const std::lock_guard lock(work_->guard);
  work_->display = &display;
}

void LiveScene::take(const LiveTick& tick) noexcept {
  work_->missed += tick.missed;
  work_->newest.write({tick, work_->missed, world_ms()});
}

void LiveScene::end() noexcept {
  const std::lock_guard lock(work_->guard);
  work_->display = nullptr;
}

std::optional<PageAnswer> LiveScene::get(std::string_view path, std::string_view) {
  if (path == "scene") return PageAnswer{"application/json", work_->facts};
  if (path == "tissues") return PageAnswer{"application/octet-stream", work_->volume.samples};
  return page_asset(path);
}

std::unique_ptr<PageFeed> LiveScene::feed() { return std::make_unique<Feed>(*work_); }

}  // namespace toothprep
