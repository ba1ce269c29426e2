#include "toothprep/tools/view/file_scene.h"

#include <algorithm>
#include <charconv>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/view/page_assets.h"
#include "toothprep/tools/view/scene_facts.h"
#include "toothprep/tools/view/wire.h"

namespace toothprep {
namespace {

constexpr std::size_t kMostRows = 600'000;  // that the page gets: 10 minutes at 1 kHz

// "a=1&b=2": the number of that name, if it is one.
std::optional<long> number_in(std::string_view query, std::string_view name) {
  while (!query.empty()) {
    const std::string_view part = query.substr(0, query.find('&'));
    query.remove_prefix(std::min(query.size(), part.size() + 1));
    if (!part.starts_with(name) || part.substr(name.size(), 1) != "=") continue;
    const std::string_view text = part.substr(name.size() + 1);
    long value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error == std::errc() && end == text.data() + text.size()) return value;
  }
  return std::nullopt;
}

bool shown_as_mesh(const ViewLayer& layer) { return !layer.tooth || !layer.mesh.triangles.empty(); }

class FileScene final : public PageSource {
 public:
  FileScene(std::vector<ViewLayer> layers, std::unique_ptr<Recording> recording,
            std::unique_ptr<Recording> other, std::string version)
      : layers_(std::move(layers)),
        recording_(std::move(recording)),
        other_(std::move(other)),
        version_(std::move(version)) {
    for (ViewLayer& layer : layers_) {
      if (shown_as_mesh(layer) || (recording_ && &layer == &layers_.back())) continue;
      workpieces_.push_back(std::make_unique<Workpiece>(*layer.tooth));
      still_[&layer] = std::make_unique<KeyFrames>(*workpieces_.back());
    }
    const ViewLayer& seen = layers_.back();
    if (seen.tooth) volume_ = tissue_volume(*seen.tooth);
    if (recording_) rerun_ = std::make_unique<Rerun>(*recording_, *seen.tooth);
  }

  std::optional<PageAnswer> get(std::string_view path, std::string_view query) override {
    const std::string json = "application/json", bytes = "application/octet-stream";
    if (path == "scene") return PageAnswer{json, scene()};
    if (path == "blocks") {
      if (auto found = blocks(query)) return PageAnswer{bytes, std::move(*found)};
      return std::nullopt;
    }
    if (path == "tissues" && volume_) return PageAnswer{bytes, volume_->samples};
    if (path == "trace" && recording_) return PageAnswer{bytes, trace(*recording_)};
    if (path == "other" && other_) return PageAnswer{bytes, trace(*other_)};
    if (path == "progress" && rerun_) return PageAnswer{json, progress(query)};
    return page_asset(path);
  }

 private:
  static std::size_t stride(const Recording& r) { return 1 + (r.rows.size() - 1) / kMostRows; }

  // Which row the page's row i is: every stride-th one, and the last.
  static std::vector<std::size_t> rows(const Recording& r) {
    std::vector<std::size_t> chosen;
    for (std::size_t i = 0; i < r.rows.size(); i += stride(r)) chosen.push_back(i);
    if (chosen.back() + 1 != r.rows.size()) chosen.push_back(r.rows.size() - 1);
    return chosen;
  }

  Box bounds() const {
    Box all{Vec3::Constant(1e30), Vec3::Constant(-1e30)};
    for (const ViewLayer& layer : layers_) {
      if (layer.tooth) {
        const Box box = bounds_of_solid(*layer.tooth);
        all = {all.min.cwiseMin(box.min), all.max.cwiseMax(box.max)};
      }
      for (const auto& vertex : layer.mesh.vertices)
        all = {all.min.cwiseMin(vertex.cast<double>()), all.max.cwiseMax(vertex.cast<double>())};
    }
    return all;
  }

  std::string scene() const {
    SceneFacts facts;
    facts.kind = recording_ ? SceneKind::kReplay : SceneKind::kSurfaces;
    facts.version = version_;
    for (const ViewLayer& layer : layers_) facts.layers.push_back(layer.name);
    facts.bounds = bounds();
    if (layers_.back().tooth) facts.provenance = layers_.back().tooth->provenance;
    if (recording_) {
      facts.bur = &recording_->bur;
      facts.parameters = &recording_->parameters;
      facts.rows = rows(*recording_).size();
      facts.stride = stride(*recording_);
      facts.session = !recording_->flags.empty();
      if (other_) facts.other_rows = rows(*other_).size();
      facts.mirror = !recording_->mirror.empty();
      facts.events = recording_->interventions.events;
      for (const Bur& bur : recording_->interventions.burs) facts.burs.push_back(&bur);
    }
    facts.deviation = !layers_.back().deviation.empty();
    if (volume_) facts.volume = &*volume_;
    return scene_json(facts);
  }

  // ?layer=0&frame=F&seen=G
  std::optional<std::string> blocks(std::string_view query) {
    const auto layer = number_in(query, "layer"), frame = number_in(query, "frame"),
               seen = number_in(query, "seen");
    if (!layer || *layer < 0 || *layer >= static_cast<long>(layers_.size())) return std::nullopt;
    const ViewLayer& wanted = layers_[static_cast<std::size_t>(*layer)];
    const bool moves = rerun_ && &wanted == &layers_.back();
    const long frames = moves ? rerun_->frames() : 1;
    if (!frame || !seen || *frame < 0 || *seen < -1 || *seen >= frames) return std::nullopt;
    const int at = static_cast<int>(std::min(*frame, frames - 1)), from = static_cast<int>(*seen);
    BlockBytes bytes(at);
    if (shown_as_mesh(wanted)) {
      if (from < 0) bytes.add(wanted.mesh, wanted.deviation);
      return bytes.take();
    }
    for (const BlockMesh& block :
         moves ? rerun_->blocks(at, from) : still_.at(&wanted)->blocks(at, from))
      bytes.add(block);
    return bytes.take();
  }

  // float64 time of each row, then its columns.
  std::string trace(const Recording& r) const {
    const std::vector<std::size_t> chosen = rows(r);
    const bool mirrored = !recording_->mirror.empty();
    const Pose none{Vec3::Constant(std::numeric_limits<double>::quiet_NaN()), Quat::Identity()};
    std::string bytes;
    bytes.reserve(chosen.size() * (sizeof(double) + sizeof(float) * row_columns(mirrored).size()));
    for (const std::size_t i : chosen) append_bytes(r.rows[i].handle.time, bytes);
    std::int64_t missed = 0;
    std::size_t counted = 0;
    for (const std::size_t i : chosen) {
      ViewRow row{&r.rows[i]};
      if (!r.flags.empty()) {
        for (; counted <= i; ++counted) missed += r.missed[counted];
        row = {&r.rows[i], r.flags[i], r.faults[i], missed};
      }
      if (mirrored) row.mirror = r.mirror.empty() ? &none : &r.mirror[i];
      append_row(row, bytes);
    }
    return bytes;
  }

  // ?from=N: frames from the N-th on.
  std::string progress(std::string_view query) const {
    const long from = number_in(query, "from").value_or(0);
    const Rerun::Progress p = rerun_->progress(static_cast<std::size_t>(std::max(0L, from)));
    return json_text(nlohmann::ordered_json{{"frame_rows", p.frame_rows},
                                            {"done", p.done},
                                            {"finished", p.finished},
                                            {"bur_difference_mm", p.bur_difference},
                                            {"force_difference_n", p.force_difference},
                                            {"failure", p.failure}});
  }

  std::vector<ViewLayer> layers_;
  std::unique_ptr<Recording> recording_, other_;
  std::string version_;
  std::vector<std::unique_ptr<Workpiece>> workpieces_;
  std::map<const ViewLayer*, std::unique_ptr<KeyFrames>> still_;
  std::optional<TissueVolume> volume_;
  std::unique_ptr<Rerun> rerun_;
};

}  // namespace

std::unique_ptr<PageSource> file_scene(std::vector<ViewLayer> layers,
                                       std::unique_ptr<Recording> recording,
                                       std::unique_ptr<Recording> other,
                                       const std::string& version) {
  if (layers.empty() || (recording && !layers.back().tooth))
    throw Error("there is no tooth to be seen");
  return std::make_unique<FileScene>(std::move(layers), std::move(recording), std::move(other),
                                     version);
}

}  // namespace toothprep
