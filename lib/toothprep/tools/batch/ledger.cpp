#include "toothprep/tools/batch/ledger.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <nlohmann/json.hpp>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/input_file.h"

namespace toothprep {
namespace {
namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr const char* kEnding = ".rows";

std::string head_text(const LedgerEntry& e) {
  Json head = {{"identity", e.identity}, {"failed", e.failed}, {"reason", e.reason},
               {"seconds", e.seconds},   {"memory", e.memory}, {"node", e.node}};
  head["files"] = Json::array();
  for (const LedgerFile& f : e.files) head["files"].push_back({f.name, f.size, f.time});
  head["outputs"] = Json::array();
  for (const auto& [name, hash] : e.outputs) head["outputs"].push_back({name, hash});
  return head.dump(-1, ' ', false, Json::error_handler_t::replace);
}

std::string figures_text(const ItemFigures& figures) {
  std::string text = "{";
  for (const auto& [key, value] : figures) {
    if (text.size() > 1) text += ',';
    text += Json(key).dump(-1, ' ', false, Json::error_handler_t::replace) + ":" + value;
  }
  return text + "}";
}

LedgerEntry read_entry(const std::string& line, bool figures) {
  const std::size_t first = line.find('\t'), second = line.find('\t', first + 1);
  LedgerEntry e;
  const Json head = Json::parse(line.substr(first + 1, second - first - 1));
  e.identity = head.at("identity");
  e.failed = head.at("failed");
  e.reason = head.at("reason");
  e.seconds = head.at("seconds");
  e.memory = head.at("memory");
  e.node = head.at("node");
  for (const Json& f : head.at("files")) e.files.push_back({f.at(0), f.at(1), f.at(2)});
  for (const Json& o : head.at("outputs")) e.outputs.emplace_back(o.at(0), o.at(1));
  if (!figures) return e;
  const Json values = Json::parse(line.substr(second + 1));
  for (const auto& [key, value] : values.items()) e.figures.emplace_back(key, value.dump());
  return e;
}

}  // namespace

Ledger::Ledger(const fs::path& folder, const std::string& own)
    : folder_(folder / ".batch" / "rows"), own_(folder_ / (own + kEnding)) {}

Ledger::~Ledger() {
  for (const int file : open_)
    if (file >= 0) close(file);
  if (append_ >= 0) close(append_);
}

void Ledger::load() {
  for (int& file : open_)
    if (file >= 0) close(file);
  files_.clear();
  open_.clear();
  places_.clear();
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder_, error))
    if (entry.path().extension() == kEnding) files_.push_back(entry.path());
  std::sort(files_.begin(), files_.end());
  if (std::find(files_.begin(), files_.end(), own_) == files_.end()) files_.push_back(own_);
  open_.assign(files_.size(), -1);
  for (std::uint32_t f = 0; f < files_.size(); ++f) {
    if (!fs::exists(files_[f], error)) continue;
    const std::string text = bytes_of_file(files_[f].string(), std::uint64_t{1} << 36);
    for (std::size_t at = 0, end; (end = text.find('\n', at)) != std::string::npos; at = end + 1) {
      const std::size_t tab = text.find('\t', at);
      if (tab == std::string::npos || tab > end) continue;
      std::vector<Place>& own = places_[text.substr(at, tab - at)];
      const Place place{f, static_cast<std::uint32_t>(end - at), at};
      if (!own.empty() && own.back().file == f)
        own.back() = place;  // of one file the last counts
      else
        own.push_back(place);
    }
  }
}

int Ledger::descriptor(std::uint32_t file) const {
  if (open_[file] < 0) open_[file] = open(files_[file].c_str(), O_RDONLY | O_CLOEXEC);
  return open_[file];
}

std::vector<LedgerEntry> Ledger::entries(const std::string& item, bool figures) const {
  std::vector<LedgerEntry> result;
  const auto found = places_.find(item);
  if (found == places_.end()) return result;
  for (const Place& p : found->second) {
    std::string line(p.length, '\0');
    if (pread(descriptor(p.file), line.data(), p.length, static_cast<off_t>(p.at)) !=
        static_cast<ssize_t>(p.length))
      continue;
    try {
      result.push_back(read_entry(line, figures));
    } catch (const Json::exception&) {  // damaged: as if it weren't there
    }
  }
  return result;
}

void Ledger::append(const std::string& item, const LedgerEntry& entry) {
  const auto fail = [&] {
    throw Error(own_.string() + ": cannot be written: " + std::strerror(errno));
  };
  std::string before;
  if (append_ < 0) {
    std::error_code error;
    fs::create_directories(folder_, error);
    append_ = open(own_.c_str(), O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
    if (append_ < 0) fail();
    const off_t size = lseek(append_, 0, SEEK_END);
    char last = '\n';
    if (size > 0 && pread(append_, &last, 1, size - 1) != 1) fail();
    if (last != '\n') before = "\n";  // ends what was cut off
    end_ = static_cast<std::uint64_t>(size);
    if (std::find(files_.begin(), files_.end(), own_) == files_.end()) {
      files_.push_back(own_);
      open_.push_back(-1);
    }
  }
  const std::string line = item + '\t' + head_text(entry) + '\t' + figures_text(entry.figures);
  const std::string text = before + line + '\n';
  if (write(append_, text.data(), text.size()) != static_cast<ssize_t>(text.size())) {
    const int error = errno;
    static_cast<void>(ftruncate(append_, static_cast<off_t>(end_)) == 0);
    errno = error == 0 ? ENOSPC : error;
    fail();
  }
  const auto file =
      static_cast<std::uint32_t>(std::find(files_.begin(), files_.end(), own_) - files_.begin());
  const Place place{file, static_cast<std::uint32_t>(line.size()), end_ + before.size()};
  std::vector<Place>& own = places_[item];
  std::erase_if(own, [&](const Place& p) { return p.file == file; });
  own.push_back(place);
  end_ += text.size();
}

std::vector<LedgerFile> files_now(const fs::path& folder) {
  std::vector<LedgerFile> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    struct stat s {};
    if (lstat(entry.path().c_str(), &s) != 0 || !S_ISREG(s.st_mode)) continue;
    files.push_back({entry.path().lexically_relative(folder).string(),
                     static_cast<std::uint64_t>(s.st_size),
                     std::int64_t{s.st_mtim.tv_sec} * 1'000'000'000 + s.st_mtim.tv_nsec});
  }
  std::sort(files.begin(), files.end(),
            [](const LedgerFile& a, const LedgerFile& b) { return a.name < b.name; });
  return files;
}

bool unchanged(const fs::path& folder, const std::vector<LedgerFile>& files) {
  return std::all_of(files.begin(), files.end(), [&](const LedgerFile& f) {
    struct stat s {};
    return stat((folder / f.name).c_str(), &s) == 0 && S_ISREG(s.st_mode) &&
           static_cast<std::uint64_t>(s.st_size) == f.size &&
           std::int64_t{s.st_mtim.tv_sec} * 1'000'000'000 + s.st_mtim.tv_nsec == f.time;
  });
}

}  // namespace toothprep
