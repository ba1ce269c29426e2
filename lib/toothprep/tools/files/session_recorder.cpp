#include "toothprep/tools/files/session_recorder.h"

#include <pthread.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <deque>
#include <filesystem>
#include <limits>
#include <optional>
#include <set>
#include <system_error>
#include <vector>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/files/body_columns.h"
#include "toothprep/tools/files/session_columns.h"
#include "toothprep/tools/files/trace_parts.h"
#include "toothprep/tools/io/rename.h"

namespace toothprep {
namespace {

// Between two looks into the ring, or between two flushes if these are more frequent.
constexpr std::chrono::milliseconds kPoll{50};

// Rows that are written at once, whole chunks of the file: a quarter of a second at most if a kill
// is to cost no more than half of one.
std::size_t rows_at_once(const SessionHeader& header, double flush_s) {
  constexpr double kMost = 1 << 14;
  return static_cast<std::size_t>(std::clamp(std::round(header.rate_hz * flush_s), 1.0, kMost));
}

// What is not known at the start.
const std::set<std::string> kKnownLater = {"torque_work_mJ",
                                           "removed_energy_mJ",
                                           "energy_ratio",
                                           "dropped_ticks",
                                           "end_reason",
                                           "registration_position_mm",
                                           "registration_hand_position_mm",
                                           "registration_hand_orientation"};
constexpr const char* kComplete = "complete";
constexpr const char* kVersion = "schema_version";  // known later if the session is controlled

std::vector<double> list(const Vec3& v) { return {v.x(), v.y(), v.z()}; }
std::vector<double> list(const Quat& q) { return {q.x(), q.y(), q.z(), q.w()}; }

void write_head(h5::Writer& out, const SessionHeader& header) {
  const double not_yet = std::numeric_limits<double>::quiet_NaN();
  Trace trace;  // without rows
  trace.parameters_toml = header.trace.parameters_toml;
  trace.tooth_sha256 = header.trace.tooth_sha256;
  trace.toothprep_version = header.trace.toothprep_version;
  trace.bur = header.trace.bur;
  trace.drive = header.trace.drive;
  trace.engine = header.trace.engine;
  trace.initial_overlap_mm3 = header.trace.initial_overlap_mm3;
  trace.audit = {not_yet, not_yet, not_yet};
  trace.events.burs = header.trace.events.burs;
  write_trace_head(out, trace);

  out.integer("live", 1);
  out.integer(kComplete, 0);
  out.integer("dropped_ticks", 0);
  out.text("end_reason", "");
  out.text("device_kind", header.device_kind);
  out.text("device_name", header.device_name);
  out.text("device_model", header.device_model);
  out.text("device_vendor", header.device_vendor);
  out.text("device_driver", header.device_driver);
  out.text("device_serial", header.device_serial);
  out.text("device_firmware", header.device_firmware);
  out.text("mirror_model", header.mirror_model);
  out.number("device_rate_hz", header.rate_hz);
  out.number("device_max_force_n", header.max_force_n);
  out.number("device_max_continuous_force_n", header.max_continuous_force_n);
  out.number("device_max_stiffness_n_per_mm", header.max_stiffness_n_per_mm);
  out.number("device_max_damping_n_s_per_mm", header.max_damping_n_s_per_mm);
  out.numbers("device_workspace_min_mm", list(header.workspace_min));
  out.numbers("device_workspace_max_mm", list(header.workspace_max));
  std::string notes;
  for (const std::string& note : header.limit_notes) notes += (notes.empty() ? "" : "\n") + note;
  out.text("device_limit_notes", notes);
  out.number("force_limit_n", header.force_limit_n);
  out.number("force_rate_limit_n_per_s", header.force_rate_limit_n_per_s);
  if (header.safety)
    for (const SafetyAttribute& a : kSafetyAttributes)
      out.number(a.name, (*header.safety).*a.value);
  out.text("safety_switch", header.safety_switch);
  out.numbers("registration_position_mm", header.laid_at_start
                                              ? std::vector<double>(3, not_yet)
                                              : list(header.registration.position));
  out.numbers("registration_orientation", list(header.registration.orientation));
  out.numbers("registration_hand_position_mm", std::vector<double>(3, not_yet));
  out.numbers("registration_hand_orientation", {0, 0, 0, 1});
  out.text("protocol", header.protocol);
  out.text("pedal", header.pedal);
  out.text("host", header.host);
}

// A value per column, before they are gathered by column.
constexpr int kMostWidth = static_cast<int>(kMostBodies);

bool make_readable(double* v, int width, bool is_quaternion) {
  bool good = true;
  for (int c = 0; c < width; ++c) good = good && std::isfinite(v[c]);
  Quat ignored;
  if (good && is_quaternion) good = accept_quaternion(Quat(v[3], v[0], v[1], v[2]), ignored);
  if (good) return true;
  for (int c = 0; c < width; ++c)
    if (is_quaternion || !std::isfinite(v[c])) v[c] = 0;
  if (is_quaternion) v[3] = 1;
  return false;
}

bool is_quaternion(const char* dataset) { return std::strstr(dataset, "orientation") != nullptr; }

}  // namespace

// The file and the rows that aren't in it yet.
class SessionRecorder::File {
 public:
  File(const std::string& path, const std::string& shown, const SessionHeader& header,
       std::size_t rows_at_once)
      : out_(path, shown, rows_at_once),
        rows_at_once_(static_cast<std::int64_t>(rows_at_once)),
        rotation_(header.registration.orientation),
        laid_(header.laid_at_start) {
    write_head(out_, header);
    for (const char* group : {"/servo", "/device"}) out_.group(group);
    if (!header.mirror_model.empty()) out_.group("/mirror");
    for (const TraceColumn& c : trace_columns())
      columns_.push_back({out_.column(c.dataset, c.unit, c.width, c.storage,
                                      c.per_tissue ? tissue_columns() : std::vector<std::string>{}),
                          c.width,
                          !c.per_tissue && is_quaternion(c.dataset),
                          c.get,
                          nullptr,
                          {}});
    for (const SessionColumn& c : session_columns())
      if (!c.mirror || !header.mirror_model.empty())
        columns_.push_back({out_.column(c.dataset, c.unit, c.width, c.storage),
                            c.width,
                            is_quaternion(c.dataset),
                            nullptr,
                            c.get,
                            {}});
    if (!header.trace.bodies.empty()) {
      bodies_ = header.trace.bodies;
      const int width = static_cast<int>(bodies_.size());
      columns_.push_back({out_.column(kBodyAreaName, "mm^2", width, Storage::kDouble,
                                      names_of(bodies_), 0, kBodyNames),
                          width,
                          false,
                          nullptr,
                          nullptr,
                          {}});
    }
    values_.resize(columns_.size());
    for (std::size_t i = 0; i < columns_.size(); ++i)
      if (columns_[i].tick_values &&
          std::strcmp(session_columns()[i - trace_columns().size()].dataset, "/servo/flags") == 0)
        flags_ = i;
    if (!header.trace.events.burs.empty()) {
      known_later_.insert(kVersion);
      out_.group("/events");
      for (const EventColumn& c : kEventColumns)  // each row is a chunk: it is written once
        events_.push_back(out_.column(c.dataset, c.unit, c.width, c.storage, {}, 1));
    }
    std::set<std::string> changing = known_later_;
    changing.insert(kComplete);
    out_.start(changing);
  }

  // False: not a row that could follow.
  bool add(const LiveTick& tick) {
    if (!(tick.row.handle.time > last_time_) || !std::isfinite(tick.row.handle.time)) return false;
    last_time_ = tick.row.handle.time;
    bool good = true;
    for (std::size_t i = 0; i < columns_.size(); ++i) {
      const Column& c = columns_[i];
      double* v = values_[i].data();
      if (c.row_values)
        c.row_values(tick.row, v);
      else if (c.tick_values)
        c.tick_values(tick, v);
      else
        get_body_areas(tick.row, bodies_, v);
      good = make_readable(v, c.width, c.quaternion) && good;
    }
    if (!good) values_[flags_][0] = tick.flags | kForceNotFinite;
    if (!began_) began_ = tick;
    if (tick.event.kind != EventKind::kNone) {
      happened_.push_back(tick.event);
      happened_.back().time = tick.row.handle.time;
    }
    for (std::size_t i = 0; i < columns_.size(); ++i)
      columns_[i].waiting.insert(columns_[i].waiting.end(), values_[i].begin(),
                                 values_[i].begin() + columns_[i].width);
    ++waiting_;
    return true;
  }

  // Writes the whole chunks, or all; how many rows.
  std::int64_t write(bool all) {
    const std::int64_t rows = all ? waiting_ : waiting_ / rows_at_once_ * rows_at_once_;
    if (rows == 0) return 0;
    const auto lock = h5::lock_hdf5();
    const h5::Quiet quiet;
    if (began_ && !registered_) write_registration(*began_);
    const auto at_last = static_cast<std::size_t>(rows - 1);
    write_events(columns_.front().waiting[at_last]);
    for (Column& c : columns_) {
      out_.append(c.index, c.waiting.data(), static_cast<std::size_t>(rows));
      c.waiting.erase(c.waiting.begin(), c.waiting.begin() + rows * c.width);
    }
    out_.flush();
    waiting_ -= rows;
    return rows;
  }

  void finish(const SessionEnd& end, std::int64_t dropped) {
    const auto lock = h5::lock_hdf5();
    const h5::Quiet quiet;
    out_.set_number("torque_work_mJ", end.audit.torque_work_mj);
    out_.set_number("removed_energy_mJ", end.audit.removed_energy_mj);
    out_.set_number("energy_ratio", end.audit.energy_ratio);
    out_.set_number("dropped_ticks", static_cast<double>(dropped));
    out_.set_text("end_reason", end.reason);
    out_.write_checksums(known_later_);
    out_.flush();
    out_.set_number(kComplete, 1);
    out_.close();
  }

  void close() {
    const auto lock = h5::lock_hdf5();
    const h5::Quiet quiet;
    out_.close();
  }

  void abandon() noexcept {
    const auto lock = h5::lock_hdf5();
    const h5::Quiet quiet;
    out_.abandon();
  }

 private:
  // Those of rows up to `time`, before these rows.
  void write_events(double time) {
    while (!happened_.empty() && happened_.front().time <= time && !events_.empty()) {
      out_.set_number(kVersion, kSchemaVersionWithEvents);
      for (std::size_t c = 0; c < events_.size(); ++c) {
        double kind = 0;
        out_.append(events_[c], event_values(happened_.front(), c, kind), 1);
      }
      happened_.pop_front();
    }
  }

  // Where the hand was when its frame was laid.
  void write_registration(const LiveTick& first) {
    registered_ = true;
    if (laid_)
      out_.set_numbers("registration_position_mm",
                       list(first.row.handle.pose.position - rotation_ * first.device_position));
    out_.set_numbers("registration_hand_position_mm", list(first.device_position));
    out_.set_numbers("registration_hand_orientation", list(first.device_orientation));
  }

  struct Column {
    std::size_t index = 0;
    int width = 1;
    bool quaternion = false;
    void (*row_values)(const StepRecord&, double*) = nullptr;
    void (*tick_values)(const LiveTick&, double*) = nullptr;
    std::vector<double> waiting;
  };
  h5::GrowingWriter out_;
  std::int64_t rows_at_once_;
  Quat rotation_;  // D to W
  bool laid_ = false, registered_ = false;
  std::optional<LiveTick> began_;  // the first one
  std::set<std::string> known_later_ = kKnownLater;
  std::vector<std::size_t> events_;    // columns; none of a session that nobody controls
  std::deque<SessionEvent> happened_;  // and aren't in the file yet
  std::vector<Column> columns_;
  std::vector<Body> bodies_;
  std::vector<std::array<double, kMostWidth>> values_;  // of one tick, by column
  std::size_t flags_ = 0;
  double last_time_ = -std::numeric_limits<double>::infinity();
  std::int64_t waiting_ = 0;
};

SessionRecorder::SessionRecorder(const std::string& path, const SessionHeader& header,
                                 const RecorderOptions& options)
    : path_(path),
      place_(std::filesystem::weakly_canonical(std::filesystem::absolute(path))),
      replace_(options.replace),
      flush_(options.flush_s),
      lock_(place_, path),
      ring_(options.capacity) {
  if (!replace_ && std::filesystem::exists(place_))
    throw Error(path + ": cannot be written: " + std::generic_category().message(EEXIST));
  part_ = std::make_unique<Part>(place_.parent_path(), place_.extension().string(), path, false);
  {
    const auto lock = h5::lock_hdf5();
    const h5::Quiet quiet;
    file_ =
        std::make_unique<File>(part_->path(), path, header, rows_at_once(header, options.flush_s));
  }
  // Signals are for the threads that expect them. SIGXFSZ would end the program where a write that
  // fails stops the recording.
  sigset_t all, before;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &before);
  thread_ = std::thread([this] { run(); });
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

SessionRecorder::~SessionRecorder() {
  stop_thread();
  if (!file_) return;
  try {
    file_->close();
  } catch (const Error&) {
    file_->abandon();
  }
}

bool SessionRecorder::push(const LiveTick& tick) noexcept {
  if (failed_.load(std::memory_order_relaxed)) return false;
  if (ring_.push(tick)) return true;
  dropped_.fetch_add(1, std::memory_order_relaxed);
  return false;
}

std::optional<std::string> SessionRecorder::failure() const {
  const std::scoped_lock guard(mutex_);
  return failure_[0] == 0 ? std::nullopt : std::optional<std::string>(failure_.data());
}

void SessionRecorder::finish(const SessionEnd& end) {
  stop_thread();
  if (const auto why = failure()) throw Error(*why);
  if (!file_) throw Error(path_ + ": the recording was finished before");
  try {
    file_->finish(end, dropped());
    file_.reset();
  } catch (const Error& e) {
    fail(e.what());
    throw Error(*failure());
  }
}

void SessionRecorder::take_place() {
  const int error = replace_ ? (std::rename(part_->path().c_str(), place_.c_str()) == 0 ? 0 : errno)
                             : rename_to_new(part_->path(), place_);
  if (error != 0)
    throw Error(path_ + ": cannot be written: " + std::generic_category().message(error));
  part_.reset();
}

void SessionRecorder::write(bool all) {
  const std::int64_t rows = file_->write(all);
  if (rows == 0) return;
  if (part_) take_place();
  rows_.fetch_add(rows, std::memory_order_relaxed);
}

void SessionRecorder::run() noexcept {
  const auto poll = std::min<std::chrono::duration<double>>(kPoll, flush_);
  try {
    for (bool last = false; !last;) {
      {
        std::unique_lock guard(mutex_);
        wake_.wait_for(guard, poll, [this] { return stop_; });
        last = stop_;  // what was pushed before it was set is taken below
      }
      ring_.consume([this](const LiveTick& tick) {
        if (!file_->add(tick)) dropped_.fetch_add(1, std::memory_order_relaxed);
      });
      write(last);
    }
  } catch (const std::exception& e) {
    fail(e.what());
  }
}

void SessionRecorder::stop_thread() noexcept {
  if (!thread_.joinable()) return;
  {
    const std::scoped_lock guard(mutex_);
    stop_ = true;
  }
  wake_.notify_one();
  thread_.join();
}

// Allocates nothing: what failed may be an allocation.
void SessionRecorder::fail(const char* why) noexcept {
  file_->abandon();
  file_.reset();
  {
    const std::scoped_lock guard(mutex_);
    failed_.store(true, std::memory_order_relaxed);  // before the reason can be read
    if (part_)
      std::snprintf(failure_.data(), failure_.size(), "%.*s; nothing was recorded",
                    static_cast<int>(failure_.size() - 64), why);
    else
      std::snprintf(failure_.data(), failure_.size(), "%.*s; its first %lld rows can be read",
                    static_cast<int>(failure_.size() - 64), why, static_cast<long long>(rows()));
  }
}

}  // namespace toothprep
