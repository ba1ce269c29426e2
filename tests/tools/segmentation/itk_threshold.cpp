// What ITK alone takes for what `voxelize` begins with: reads a scan (NRRD) in the file's own type of pixel, resamples it
// linearly to cubic voxels over its whole extent where a voxel size is given, and thresholds it half-way between its
// least and greatest grey.
//
//     itk_threshold SCAN.nrrd [VOXEL_MM]
#include <itkBinaryThresholdImageFilter.h>
#include <itkImageFileReader.h>
#include <itkMinimumMaximumImageCalculator.h>
#include <itkNrrdImageIO.h>
#include <itkResampleImageFilter.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>

namespace {

template <class Pixel>
int threshold(itk::NrrdImageIO* io, const char* path, double voxel) {
  using Image = itk::Image<Pixel, 3>;
  using Mask = itk::Image<unsigned char, 3>;
  const auto reader = itk::ImageFileReader<Image>::New();
  reader->SetFileName(path);
  reader->SetImageIO(io);
  reader->Update();
  typename Image::Pointer image = reader->GetOutput();
  if (voxel > 0) {
    const auto resample = itk::ResampleImageFilter<Image, Image>::New();
    typename Image::SizeType size = image->GetLargestPossibleRegion().GetSize();
    for (unsigned a = 0; a < 3; ++a)
      size[a] = static_cast<itk::SizeValueType>(
          std::ceil(static_cast<double>(size[a]) * image->GetSpacing()[a] / voxel));
    typename Image::SpacingType spacing;
    spacing.Fill(voxel);
    resample->SetInput(image);
    resample->SetSize(size);
    resample->SetOutputSpacing(spacing);
    resample->SetOutputOrigin(image->GetOrigin());
    resample->SetOutputDirection(image->GetDirection());
    resample->Update();
    image = resample->GetOutput();
  }
  const auto range = itk::MinimumMaximumImageCalculator<Image>::New();
  range->SetImage(image);
  range->Compute();
  const auto filter = itk::BinaryThresholdImageFilter<Image, Mask>::New();
  filter->SetInput(image);
  filter->SetLowerThreshold(
      static_cast<Pixel>((static_cast<int>(range->GetMinimum()) + range->GetMaximum()) / 2));
  filter->Update();
  std::printf("%zu voxels\n",
              static_cast<std::size_t>(image->GetLargestPossibleRegion().GetNumberOfPixels()));
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) return 2;
  const double voxel = argc > 2 ? std::atof(argv[2]) : 0;
  const auto io = itk::NrrdImageIO::New();
  io->SetFileName(argv[1]);
  io->ReadImageInformation();
  switch (io->GetComponentType()) {
    case itk::IOComponentEnum::UCHAR:
      return threshold<unsigned char>(io, argv[1], voxel);
    case itk::IOComponentEnum::SHORT:
      return threshold<short>(io, argv[1], voxel);
    default:
      std::fprintf(stderr, "itk_threshold: %s: neither 8 bits nor 16 with a sign\n", argv[1]);
      return 1;
  }
}
