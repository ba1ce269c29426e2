#include "toothprep/tools/view/live_scene.h"

#include <chrono>
#include <cmath>
#include <limits>
#include <mutex>
#include <nlohmann/json.hpp>
#include <utility>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/render/view.h"
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
  kState = 3,   // text: JSON of the control's state, or of why a message was refused
};

double world_ms() {
  return std::chrono::duration<double, std::milli>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

constexpr double kFarthest = 100;  // mm, that the tooth is moved at once

// Throws for what is no command; Error says why.
ControlCommand parse_command(std::string_view message, const Vec3& occlusal) {
  const auto j = nlohmann::json::parse(message, nullptr, false);
  if (!j.is_object() || !j.contains("do") || !j["do"].is_string())
    throw Error("a command is an object with 'do'");
  const std::string what = j["do"];
  ControlCommand command;
  for (std::uint32_t k = 1; k < kEventKinds; ++k)
    if (name_of(static_cast<EventKind>(k)) == (what == "move" ? "registration" : what))
      command.kind = static_cast<EventKind>(k);
  if (command.kind == EventKind::kNone || what == "registration")
    throw Error("there is no such command");
  const bool moves = command.kind == EventKind::kRegistration,
             changes = command.kind == EventKind::kBur;
  if (j.size() != 1u + (changes ? 1 : moves ? 2 : 0)) throw Error("it has not what it needs");
  if (changes) {
    if (!j.contains("bur") || !j["bur"].is_number_unsigned() || j["bur"] > 10000)
      throw Error("'bur' must be a place in the list");
    command.bur = j["bur"];
  }
  if (!moves) return command;
  const auto shift = j.value("shift_mm", nlohmann::json()),
             turn = j.value("turn_deg", nlohmann::json());
  if (!shift.is_array() || shift.size() != 3 || !turn.is_number())
    throw Error("'shift_mm' must be three numbers, 'turn_deg' one");
  for (int i = 0; i < 3; ++i) {
    if (!shift[static_cast<std::size_t>(i)].is_number()) throw Error("'shift_mm' must be numbers");
    command.shift[i] = shift[static_cast<std::size_t>(i)];
  }
  const double degrees = turn;
  if (!(command.shift.norm() <= kFarthest && std::abs(degrees) <= 180))
    throw Error("at most 100 mm and 180 degrees");
  command.turn = Quat(Eigen::AngleAxisd(degrees * units::kPi / 180, occlusal));
  return command;
}

std::string state_text(const ControlStatus& status) {
  return json_text(nlohmann::ordered_json{{"state", name_of(status.state)},
                                          {"bur", status.bur},
                                          {"undoable", status.undoable},
                                          {"note", status.note}});
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
  Vec3 occlusal = Vec3::UnitY();  // of the tooth
  SessionControl* control = nullptr;
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
    if (std::string text = new_state(); !text.empty()) {
      std::string bytes;
      append_bytes(kState, bytes);
      return bytes + text;
    }
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
    Pose mirror{m.tick.mirror_position, m.tick.mirror_orientation};
    if (!m.tick.has_mirror) mirror.position.setConstant(std::numeric_limits<double>::quiet_NaN());
    append_row({&m.tick.row, m.tick.flags, m.tick.fault, m.missed, &mirror}, bytes);
    return bytes;
  }

  void hear(std::string_view message) override {
    std::string why = "this page can only look: live --view --control lets it do more";
    if (work_.control) {
      why.clear();
      try {
        if (!work_.control->ask(parse_command(message, work_.occlusal)))
          why = "too many commands wait";
      } catch (const Error& e) {
        why = e.what();
      }
    }
    if (!why.empty()) refusal_ = json_text(nlohmann::ordered_json{{"refused", why}});
  }

 private:
  std::string new_state() {
    if (!refusal_.empty()) return std::exchange(refusal_, {});
    if (!work_.control) return {};
    const ControlStatus status = work_.control->status();
    if (status.change == seen_change_) return {};
    seen_change_ = status.change;
    return state_text(status);
  }

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
  std::uint64_t generation_ = 0, seen_moments_ = 0, seen_change_ = 0;
  std::string refusal_;
  Clock::time_point surface_due_{};
};

LiveScene::LiveScene(const Bur& bur, const LayeredTooth& tooth, const Parameters& parameters,
                     const std::string& name, const std::string& version, SessionControl* control,
                     const std::vector<const Bur*>& burs)
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
  facts.mirror = true;
  facts.volume = &work_->volume;
  facts.control = control != nullptr;
  facts.burs = burs;
  work_->control = control;
  work_->occlusal = tooth_axes(tooth.provenance).occlusal;
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
