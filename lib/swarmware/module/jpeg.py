"""Images of cameras as JPEG, and back as pixels; needs Pillow, the extra `images`."""

import io
from types import ModuleType
from typing import Final

import msgspec

from swarmware.errors import InvalidInput, NotFound, WireError
from swarmware.types.perception import Image, ImageEncoding

_PILLOW_MODES: Final = {"mono8": "L", "rgb8": "RGB"}


def to_jpeg(image: Image, quality: int) -> Image:
    """The image as JPEG; a JPEG image stays as it is.

    Units: quality from 1 to 95. Raises: InvalidInput for other encodings and for pixels that do not fit width
    and height, NotFound without Pillow.
    """
    if image.encoding == ImageEncoding.JPEG:
        return image
    pillow = _pillow()
    mode = _PILLOW_MODES.get(str(image.encoding))
    if mode is None:
        raise InvalidInput(f"image of encoding {image.encoding}: expected one of {', '.join(_PILLOW_MODES)}")
    expected = image.width * image.height * len(mode)
    if len(image.data) != expected or not expected:
        raise InvalidInput(
            f"image of {image.width}x{image.height} {image.encoding} with {len(image.data)} bytes:"
            f" expected {expected}"
        )
    out = io.BytesIO()
    pillow.frombytes(mode, (image.width, image.height), image.data).save(out, "JPEG", quality=quality)
    return msgspec.structs.replace(image, encoding=ImageEncoding.JPEG, data=out.getvalue())


def to_pixels(image: Image) -> Image:
    """The image as pixels, `mono8` or `rgb8`; an image of pixels stays as it is.

    Raises: WireError for a damaged file and one of another size than stated, NotFound without Pillow.
    """
    if image.encoding != ImageEncoding.JPEG:
        return image
    pillow = _pillow()
    try:
        with pillow.open(io.BytesIO(image.data), formats=["JPEG"]) as file:
            # checked before the pixels are allocated: the sender states the size
            if file.size != (image.width, image.height):
                raise WireError(
                    f"JPEG of {file.size[0]}x{file.size[1]}: stated are {image.width}x{image.height}"
                )
            encoding = ImageEncoding.MONO8 if file.mode == _PILLOW_MODES["mono8"] else ImageEncoding.RGB8
            pixels = file.convert(_PILLOW_MODES[str(encoding)]).tobytes()
    except (OSError, SyntaxError, ValueError, pillow.DecompressionBombError) as error:
        raise WireError(f"JPEG of {len(image.data)} bytes: {error}") from error
    return msgspec.structs.replace(image, encoding=encoding, data=pixels)


def _pillow() -> ModuleType:
    try:
        import PIL.Image
    except ImportError:
        raise NotFound("JPEG needs Pillow: pip install 'swarmware[images]'") from None
    return PIL.Image
