"""Renders a volume with VTK's ray caster on the processor, and writes the picture as NumPy array.

    python vtk_picture.py JOB.json OUT.npy

A process of its own, as VTK ends the one that it is in when it finds no OpenGL: it shows the picture that its ray caster
made as a texture, which Mesa's software renderer is enough for.
"""

import json
import sys

import numpy
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401, registers the factories
import vtkmodules.vtkRenderingVolumeOpenGL2  # noqa: F401
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkPiecewiseFunction
from vtkmodules.vtkRenderingCore import (vtkColorTransferFunction, vtkRenderer, vtkRenderWindow, vtkVolume,
                                         vtkVolumeProperty, vtkWindowToImageFilter)
from vtkmodules.vtkRenderingVolume import vtkFixedPointVolumeRayCastMapper


def image(job):
    voxels = numpy.load(job["voxels"])  # z, y, x
    data = vtkImageData()
    data.SetDimensions(*voxels.shape[::-1])
    data.SetSpacing(job["spacing"])
    data.SetOrigin(job["origin"])
    data.GetPointData().SetScalars(numpy_to_vtk(voxels.ravel(), deep=True))
    return data


def volume(job):
    colour, opacity = vtkColorTransferFunction(), vtkPiecewiseFunction()
    for value, red, green, blue, alpha in job["points"]:
        colour.AddRGBPoint(value, red, green, blue)
        opacity.AddPoint(value, alpha)
    looks = vtkVolumeProperty()
    looks.SetColor(colour)
    looks.SetScalarOpacity(opacity)
    looks.SetScalarOpacityUnitDistance(job["unit"])
    looks.SetInterpolationTypeToLinear()
    looks.ShadeOff()
    mapper = vtkFixedPointVolumeRayCastMapper()
    mapper.SetInputData(image(job))
    mapper.SetSampleDistance(job["step"])
    mapper.SetImageSampleDistance(1.0)
    mapper.AutoAdjustSampleDistancesOff()
    mapper.LockSampleDistanceToInputSpacingOff()
    mapper.IntermixIntersectingGeometryOff()
    mapper.SetNumberOfThreads(2)
    actor = vtkVolume()
    actor.SetMapper(mapper)
    actor.SetProperty(looks)
    return actor


def main():
    with open(sys.argv[1], encoding="utf-8") as file:
        job = json.load(file)
    renderer = vtkRenderer()
    renderer.SetBackground(0.0, 0.0, 0.0)
    renderer.AddVolume(volume(job))
    window = vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(0)
    window.SetSize(*job["size"])
    window.AddRenderer(renderer)
    camera = renderer.GetActiveCamera()
    camera.SetPosition(job["eye"])
    camera.SetFocalPoint(job["target"])
    camera.SetViewUp(job["up"])
    camera.SetViewAngle(job["angle"])
    renderer.ResetCameraClippingRange()
    window.Render()
    grab = vtkWindowToImageFilter()
    grab.SetInput(window)
    grab.SetInputBufferTypeToRGB()
    grab.ReadFrontBufferOff()
    grab.Update()
    picture = grab.GetOutput()
    width, height, _ = picture.GetDimensions()
    pixels = vtk_to_numpy(picture.GetPointData().GetScalars()).reshape(height, width, -1)
    # VTK counts rows from below.
    numpy.save(sys.argv[2], pixels[::-1])


if __name__ == "__main__":
    main()
