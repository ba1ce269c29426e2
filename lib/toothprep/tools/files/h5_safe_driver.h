// A driver for HDF5 under which a file that grows is readable whenever its program is killed.
//
// HDF5 writes blocks of its own (heads of datasets, indices of chunks) anew in place, each with a
// checksum. A kill ends a write(2) at any page's border, and the block, half old and half new, can't
// be read any more, nor can the rows that it leads to. So what is to be written in place is put at
// the end of the file first, with its address and a checksum; then it is written in place; then the
// end is cut off again. Not so of rows: GrowingWriter writes each once, before anything leads to it.
// Whoever opens the file with this driver finds what stands at the end in its
// place. Without a kill the file has the bytes that HDF5's own driver gives it.
#pragma once

#include "toothprep/tools/files/hdf5_handle.h"

namespace toothprep::h5 {

// Files that are opened with these access properties are written and read so; negative: HDF5 can't.
int use_safe_driver(Id access);

}  // namespace toothprep::h5
