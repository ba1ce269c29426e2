// What there is to draw in a file, for the commands that draw pictures.
#pragma once

#include <memory>
#include <string>

#include "toothprep/tools/render/part.h"

namespace toothprep::app {

struct Drawn {
  std::unique_ptr<LayeredTooth> tooth;  // that the part points to, if the file is one
  RenderPart part;
};

// A tooth (.vdb) or a mesh with the tissues of its vertices, if it has them. Throws InputError. Of
// the warnings on a tooth `strict` makes errors.
Drawn read_drawn(const std::string& path, bool strict = false);

}  // namespace toothprep::app
