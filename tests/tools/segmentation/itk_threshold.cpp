// What ITK alone takes for what `voxelize` begins with: reads a scan (NRRD), resamples it linearly to cubic voxels
// over its whole extent where a voxel size is given, and thresholds it half-way between its least and greatest grey.
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

int main(int argc, char** argv) {
  using Image = itk::Image<float, 3>;
  using Mask = itk::Image<unsigned char, 3>;
  if (argc < 2) return 2;
  const auto reader = itk::ImageFileReader<Image>::New();
  reader->SetFileName(argv[1]);
  reader->SetImageIO(itk::NrrdImageIO::New());
  reader->Update();
  Image::Pointer image = reader->GetOutput();
  if (argc > 2) {
    const double voxel = std::atof(argv[2]);
    const auto resample = itk::ResampleImageFilter<Image, Image>::New();
    Image::SizeType size = image->GetLargestPossibleRegion().GetSize();
    for (unsigned a = 0; a < 3; ++a)
      size[a] = static_cast<itk::SizeValueType>(
          std::ceil(static_cast<double>(size[a]) * image->GetSpacing()[a] / voxel));
    Image::SpacingType spacing;
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
  const auto threshold = itk::BinaryThresholdImageFilter<Image, Mask>::New();
  threshold->SetInput(image);
  threshold->SetLowerThreshold(0.5F * (range->GetMinimum() + range->GetMaximum()));
  threshold->Update();
  std::printf("%zu voxels\n",
              static_cast<std::size_t>(image->GetLargestPossibleRegion().GetNumberOfPixels()));
}
