#include "toothprep/tools/files/h5_checksums.h"

#include <hdf5.h>

#include <algorithm>

#include "toothprep/step/core/hash.h"

namespace toothprep::h5 {
namespace {

constexpr hsize_t kBlockBytes = 1 << 20;   // read at once
constexpr std::int64_t kMostTexts = 1000;  // of an attribute

std::string sha256(const std::string& text) {
  Sha256 hash;
  hash.update(text.data(), text.size());
  return hash.hex();
}

// "f8" and so on; empty for what isn't a little-endian number.
std::string type_name(Id type) {
  const std::size_t bytes = H5Tget_size(type);
  if (bytes > 1 && H5Tget_order(type) != H5T_ORDER_LE) return {};
  const H5T_class_t kind = H5Tget_class(type);
  if (kind == H5T_FLOAT) return "f" + std::to_string(bytes);
  if (kind != H5T_INTEGER) return {};
  return (H5Tget_sign(type) == H5T_SGN_NONE ? "u" : "i") + std::to_string(bytes);
}

std::string shape_name(const std::vector<std::uint64_t>& shape) {
  std::string text;
  for (const std::uint64_t n : shape) text += (text.empty() ? "" : "x") + std::to_string(n);
  return text.empty() ? "1" : text;
}

std::vector<std::uint64_t> shape_of(Id space) {
  hsize_t size[H5S_MAX_RANK] = {};
  const int dimensions = H5Sget_simple_extent_ndims(space);
  if (dimensions > 0) H5Sget_simple_extent_dims(space, size, nullptr);
  return {size, size + std::max(dimensions, 0)};
}

std::string line(const std::string& place, const std::string& type, const std::string& shape,
                 const std::string& hash) {
  return place + ' ' + type + ' ' + shape + ' ' + hash;
}

// The hash of a dataset's stored bytes, some rows at a time.
std::optional<std::string> hash_of(Id set, Id type, const std::vector<std::uint64_t>& shape) {
  Sha256 hash;
  hsize_t row = H5Tget_size(type);
  for (std::size_t d = 1; d < shape.size(); ++d) row *= shape[d];
  if (row == 0 || row > kBlockBytes || shape.empty()) return {};
  const Handle stored(H5Dget_space(set), H5Sclose);
  std::vector<hsize_t> start(shape.size(), 0), count(shape.begin(), shape.end());
  std::vector<char> bytes;
  while (start[0] < shape[0]) {
    count[0] = std::min<hsize_t>(kBlockBytes / row, shape[0] - start[0]);
    bytes.resize(count[0] * row);
    const Handle memory(H5Screate_simple(static_cast<int>(count.size()), count.data(), nullptr),
                        H5Sclose);
    H5Sselect_hyperslab(stored.get(), H5S_SELECT_SET, start.data(), nullptr, count.data(), nullptr);
    if (H5Dread(set, type, memory.get(), stored.get(), H5P_DEFAULT, bytes.data()) < 0) return {};
    hash.update(bytes.data(), bytes.size());
    start[0] += count[0];
  }
  return hash.hex();
}

}  // namespace

std::optional<std::string> attribute_line(Id file, const std::string& path,
                                          const std::string& name) {
  const Handle attribute(
      H5Aopen_by_name(file, path.c_str(), name.c_str(), H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
  if (!attribute) return {};
  const Handle type(H5Aget_type(attribute.get()), H5Tclose);
  const Handle space(H5Aget_space(attribute.get()), H5Sclose);
  const std::int64_t count = H5Sget_simple_extent_npoints(space.get());
  const std::string place = path + '@' + name, shape = shape_name(shape_of(space.get()));
  if (H5Tget_class(type.get()) == H5T_STRING) {
    const auto texts = texts_of(attribute, kMostTexts);
    if (!texts) return {};
    std::string all;
    for (std::size_t i = 0; i < texts->size(); ++i) all += (i == 0 ? "" : "\n") + (*texts)[i];
    return line(place, "text", shape, sha256(all));
  }
  const std::string kind = type_name(type.get());
  if (kind.empty() || count < 1 || count > kMostTexts) return {};
  std::string bytes(static_cast<std::size_t>(count) * H5Tget_size(type.get()), '\0');
  if (H5Aread(attribute.get(), type.get(), bytes.data()) < 0) return {};
  return line(place, kind, shape, sha256(bytes));
}

std::optional<std::string> dataset_line(Id file, const std::string& path,
                                        const std::function<void(std::size_t)>& announce) {
  const Handle set(H5Dopen2(file, path.c_str(), H5P_DEFAULT), H5Dclose);
  if (!set) return {};
  const Handle type(H5Dget_type(set.get()), H5Tclose);
  const Handle space(H5Dget_space(set.get()), H5Sclose);
  const std::int64_t count = H5Sget_simple_extent_npoints(space.get());
  if (type_name(type.get()).empty() || count < 1) return {};
  announce(static_cast<std::size_t>(count));
  const std::vector<std::uint64_t> shape = shape_of(space.get());
  const auto hash = hash_of(set.get(), type.get(), shape);
  return hash ? std::optional(dataset_line(path, type.get(), shape, *hash)) : std::nullopt;
}

std::string dataset_line(const std::string& path, Id type, const std::vector<std::uint64_t>& shape,
                         const std::string& hash) {
  return line(path, type_name(type), shape_name(shape), hash);
}

std::string checksum_list(const std::set<std::string>& lines) {
  std::string list;
  for (const std::string& l : lines) list += l + '\n';
  return list + "end " + sha256(list) + '\n';
}

std::vector<std::string> differing(Id file, const std::string& list,
                                   const std::function<void(std::size_t)>& announce) {
  const std::size_t end = list.rfind("end ");
  if (end == std::string::npos || list.substr(end) != "end " + sha256(list.substr(0, end)) + '\n')
    return {"the list of checksums"};
  std::vector<std::string> different;
  for (std::size_t at = 0; at < end;) {
    const std::size_t next = list.find('\n', at);
    const std::string wanted = list.substr(at, next - at),
                      place = wanted.substr(0, wanted.find(' '));
    const std::size_t name = place.find('@');
    const auto found = name == std::string::npos
                           ? dataset_line(file, place, announce)
                           : attribute_line(file, place.substr(0, name), place.substr(name + 1));
    if (found != wanted)
      different.push_back(name == std::string::npos ? place
                          : name == 1
                              ? "attribute " + place.substr(2)
                              : place.substr(0, name) + ", attribute " + place.substr(name + 1));
    at = next + 1;
  }
  return different;
}

}  // namespace toothprep::h5
