"""OpenGL without a window: one EGL context, the programs that run on it, and what can go wrong with it."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import files

import moderngl

from services.mocap.energy.egl_setup import INDEX_VARIABLE
from services.mocap.energy.snapping import LIMIT_STEPS, NEAR_M, SUBPIXEL_BITS
from services.mocap.errors import UserError

GROUP = 128
"""Invocations per work group."""
MAX_GROUPS = 65535
"""Work groups per dimension that every OpenGL has."""
_OPENGL = 430
_INT64 = "GL_ARB_gpu_shader_int64"
_KERNELS = ("compose", "project", "outline", "gain", "cover")
_HEADINGS = ("GLSL Compiler failed", "GLSL Linker failed", "compute_shader", "Program", "Compute info")
"""Lines of moderngl's and NVIDIA's compiler logs that tell nothing."""
_NO_SUCH_DEVICE = "requested device index"  # as glcontext says it
_SOFTWARE = ("llvmpipe", "softpipe", "swrast", "swiftshader", "software rasterizer", "basic render")
_HEADER = f"""#version 430
#extension {_INT64} : require
#define GROUP {GROUP}
#define SUBPIXEL_BITS {SUBPIXEL_BITS}
#define SUBPIXEL {1 << SUBPIXEL_BITS}
#define LIMIT_STEPS {LIMIT_STEPS!r}lf
#define NEAR_M {NEAR_M!r}lf
"""


class GlUnavailableError(UserError):
    """No OpenGL here that the energy can be evaluated with."""


class NoSuchDeviceError(GlUnavailableError):
    """There are fewer EGL devices than that."""


class GlLostError(UserError):
    """OpenGL stopped working, or was closed, while it was in use."""


def is_software(renderer: str) -> bool:
    """Whether a program on the CPU draws, and not a GPU, by the renderer's name."""
    return any(name in renderer.lower() for name in _SOFTWARE)


class GlDevice:
    """One EGL context, on the device of that index unless GLCONTEXT_DEVICE_INDEX names another, and its
    kernels.

    Open it in the process and thread that uses it, after any fork. Raises GlUnavailableError where there is
    no EGL, no OpenGL 4.3 or no 64-bit whole numbers in shaders, or where a kernel does not compile;
    NoSuchDeviceError where EGL has no such device.
    """

    def __init__(self, index: int = 0) -> None:
        named = os.environ.get(INDEX_VARIABLE)
        try:
            self.index = int(named or index)
            """Which of EGL's devices it is on."""
            self.context: moderngl.Context = moderngl.create_standalone_context(
                require=_OPENGL,
                backend="egl",  # type: ignore[arg-type]  # its stub has settings wrong
                device_index=self.index,  # type: ignore[arg-type]
            )
        except Exception as problem:  # moderngl and glcontext raise the bare class
            reason = _first_line(problem)
            error = NoSuchDeviceError if reason.startswith(_NO_SUCH_DEVICE) else GlUnavailableError
            why = f"{INDEX_VARIABLE}={named}: {reason}" if named else reason
            raise error(f"OpenGL 4.3 on EGL cannot be opened: {why}") from None
        self._entered, self._info = False, self.context.info
        self.is_open = True
        """Whether it has not been closed."""
        self.renderer, self.version = str(self._info["GL_RENDERER"]), str(self._info["GL_VERSION"])
        """What draws, and OpenGL's version with the driver's, as the driver words them."""
        self.is_hardware = not is_software(self.renderer)
        """Whether a GPU draws, and not a program on the CPU."""
        try:
            self._programs = {name: self._compile(name) for name in _KERNELS}
        except GlUnavailableError:
            self.context.release()
            raise
        # No longer current: what is current cannot be freed, and others may use OpenGL in this thread.
        self.context.__exit__(None, None, None)  # type: ignore[no-untyped-call]

    @property
    def max_buffer_bytes(self) -> int:
        """The most that a shader sees of one buffer."""
        return int(self._info["GL_MAX_SHADER_STORAGE_BLOCK_SIZE"])

    @contextmanager
    def current(self) -> Iterator[moderngl.Context]:
        """Make the context current, and none afterwards; may be nested.

        Raises GlLostError where that, or anything done with it, fails.
        """
        if not self.is_open:
            raise GlLostError("OpenGL is closed: open a new GlDevice")
        if self._entered:  # EGL's context of glcontext forgets on leaving what was current before
            yield self.context
            return
        try:
            with self.context:
                self._entered = True
                yield self.context
                if (error := self.context.error) != "GL_NO_ERROR":
                    raise GlLostError(f"{self.renderer} stopped working: OpenGL reports {error}")
        except moderngl.Error as problem:
            raise GlLostError(f"{self.renderer} stopped working: {_first_line(problem)}") from None
        finally:
            self._entered = False

    def program(self, name: str) -> moderngl.ComputeShader:
        """The kernel of that name."""
        return self._programs[name]

    def close(self) -> None:
        """Release the programs and the context."""
        if self.is_open:
            self.is_open = False
            with self.context:
                for program in self._programs.values():
                    program.release()
            self.context.release()

    def _compile(self, name: str) -> moderngl.ComputeShader:
        if _INT64 not in self.context.extensions:
            raise GlUnavailableError(f"{self.renderer}: {_INT64} is missing: install a newer driver")
        shaders = files(__package__) / "shaders"
        source = "".join((shaders / f"{part}.glsl").read_text("utf-8") for part in ("common", name))
        try:
            return self.context.compute_shader(_HEADER + source)
        except moderngl.Error as problem:
            raise GlUnavailableError(
                f"{self.renderer}: the kernel {name} does not compile: {_first_line(problem)}"
            ) from None


def _first_line(problem: Exception) -> str:
    """The first line of a message, or of a compiler's log below its heading."""
    lines = [line.strip() for line in str(problem).splitlines()]
    telling = [line for line in lines if line.strip("=-") and line not in _HEADINGS]
    return telling[0] if telling else type(problem).__name__
