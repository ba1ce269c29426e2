// What the header of a NRRD, NIfTI or MetaImage file says about its voxels: where they are, how they
// are stored, how large they are. ITK reads these headers too, but only to read all voxels at once,
// and it takes a spacing that can't be one for 1 mm.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/tools/scan_files/itk_io.h"

namespace toothprep::image {

struct DataPlace {
  std::vector<std::string> files;  // with the voxels: one, unless a NRRD header names several
  std::uint64_t starts = 0;        // bytes before what is read, be it deflated or not
  std::uint64_t offset = 0;        // bytes of it, inflated, before the voxels
  bool compressed = false;
  bool deflated = false;  // by zlib or gzip
  bool big_endian = false;
  std::optional<itk::IOComponentEnum> type = {};  // if ITK turns the values into another one
  double slope = 1, intercept = 0;
  bool plain = true;  // nothing else has to be known to read the voxels one after the other
};

// These throw InputError for headers that can't be right, and std::runtime_error with the reason for
// what is no such header.
DataPlace data_place(const std::string& path, Format format);

// That every file with voxels is a regular one.
void check_data_files(const std::string& path, const DataPlace& place);

// That they hold as many bytes as the header promises, neither fewer nor more, as far as the files'
// sizes show it.
void check_bytes(const std::string& path, const DataPlace& place, double promised);

// That the voxel size along every axis is a positive number, if it is stated at all, and stated
// once: of NIfTI, pixdim against the sform's columns.
void check_spacing(const std::string& path, Format format);

// The unit of a NRRD file, which ITK does not apply.
double nrrd_unit_mm(const std::string& path);

}  // namespace toothprep::image
