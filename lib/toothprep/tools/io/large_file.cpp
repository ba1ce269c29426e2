#include "toothprep/tools/io/large_file.h"

#include <tbb/parallel_pipeline.h>

#include <algorithm>

#include "toothprep/tools/io/input_file.h"

namespace toothprep {
namespace {

constexpr std::size_t kPiece = std::size_t{1} << 22;  // bytes
constexpr std::size_t kPiecesAtOnce = 16;

}  // namespace

FileBytes large_file(const std::string& path, std::uint64_t most,
                     const std::function<void(std::span<const char>)>& take) {
  const InputFile file(path);
  file.require_at_most(most);
  const std::size_t size = file.size();
  FileBytes bytes{std::unique_ptr<char[]>(new char[size]), 0};
  const auto length_at = [&](std::size_t at) { return std::min(kPiece, size - at); };
  std::size_t next = 0;
  bool ended = false;  // the file has become shorter
  tbb::parallel_pipeline(
      kPiecesAtOnce, tbb::make_filter<void, std::size_t>(tbb::filter_mode::serial_in_order,
                                                         [&](tbb::flow_control& control) {
                                                           const std::size_t at = next;
                                                           if (at == size)
                                                             control.stop();
                                                           else
                                                             next += length_at(at);
                                                           return at;
                                                         }) &
                         tbb::make_filter<std::size_t, std::span<const char>>(
                             tbb::filter_mode::parallel,
                             [&](std::size_t at) {
                               char* piece = bytes.storage.get() + at;
                               return std::span<const char>(piece,
                                                            file.read(at, length_at(at), piece));
                             }) &
                         tbb::make_filter<std::span<const char>, void>(
                             tbb::filter_mode::serial_in_order, [&](std::span<const char> piece) {
                               if (ended) return;
                               ended = piece.size() < length_at(bytes.size);
                               bytes.size += piece.size();
                               take(piece);
                             }));
  return bytes;
}

}  // namespace toothprep
