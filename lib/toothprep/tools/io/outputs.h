// All that a command writes, checked before it runs and put in place together when it is done.
//
//   Outputs outputs(force);
//   outputs.reads({tooth, trajectory});
//   const std::string trace = outputs.file(o.output, {".h5"});
//   const std::string prepared = outputs.optional_file(o.prepared, {".vdb"});
//   outputs.begin();
//   ... write_trace(result, trace); if (!prepared.empty()) write_tooth(tooth, prepared); ...
//   outputs.publish();
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

namespace toothprep {

// Whether `path` is `folder` or lies in it; both absolute and without links.
bool lies_in(const std::filesystem::path& path, const std::filesystem::path& folder);

class Outputs {
 public:
  explicit Outputs(bool force);
  ~Outputs();  // what was not published is removed
  Outputs(const Outputs&) = delete;
  Outputs& operator=(const Outputs&) = delete;

  // Files and folders that the command reads. What is empty or doesn't exist is passed over.
  void reads(const std::vector<std::string>& paths);

  // An output, and where to write it: an empty file with the extension of `path`, or an empty
  // folder. `extensions` (".h5") are those of its formats. Throws InputError if it
  //   exists and there is no `force`, or is a folder that holds anything that we didn't write;
  //   is no regular file or folder, or has another format's extension;
  //   can't be written, because its folder does not exist or is read-only;
  //   is being recorded by a session that runs.
  std::string file(const std::string& path, const std::vector<std::string>& extensions);
  std::string folder(const std::string& path);
  // The same for one that need not be named: empty if `path` is.
  std::string optional_file(const std::string& path, const std::vector<std::string>& extensions);
  std::string optional_folder(const std::string& path);
  // One that takes its place as soon as it has content, since it is read while it grows: checked as
  // the others are, but never touched.
  void growing(const std::string& path, const std::vector<std::string>& extensions);

  // Throws InputError if an output
  //   is an input, by whatever name or link, or would replace one, or holds one (a folder);
  //   is another output, or lies in one.
  // Removes what killed processes left beside the outputs.
  void begin();

  // Checks that everything was written, carries it to the disk, and gives all of it its names: all
  // or, if one can't be, none (Error). What appeared at a place meanwhile stays unless `force`.
  void publish();

 private:
  struct Input;
  struct Output;
  enum class Kind { kFile, kFolder, kGrowing };
  Output& add(const std::string& path, Kind kind, const std::vector<std::string>& extensions);
  void check_against_inputs(const Output& output) const;
  void put_in_place(Output& output) const;

  void take_back(Output& output) const;

  bool force_, begun_ = false;
  std::vector<Input> inputs_;
  std::vector<std::unique_ptr<Output>> outputs_;
};

}  // namespace toothprep
