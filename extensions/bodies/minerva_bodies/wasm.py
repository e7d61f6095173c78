"""Rapier as WebAssembly: the names of `rapier3d` that `Engine` uses, with the same bits everywhere.

The file is that of the npm package @dimforge/rapier3d-deterministic; wasmtime compiles it. Its
functions take numbers and addresses: a tuple of three or four numbers becomes a vector or a
quaternion for the time of a call. Rapier's calls of JavaScript are answered in WebAssembly, too:
they write numbers into a memory from which a whole space is read at once.
"""

from __future__ import annotations

import hashlib
import re
import sys
from collections.abc import Sequence
from functools import lru_cache, partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final, NamedTuple, cast

import numpy as np
import wasmtime
from numpy.typing import ArrayLike, NDArray

from minerva_bodies.engine import Engine
from minerva_bodies.errors import BodiesError
from minerva_bodies.rigid import Rigid

PACKAGE: Final = "@dimforge/rapier3d-deterministic"
VERSION: Final = "0.21.0"
DIGEST: Final = "4e9890fd2df60072f9db06a33e4030221249c1b3687b722b2388c21f09e97551"
"""SHA-256 of the file of this version; another version would compute other bits."""

library: Any = wasmtime
"""Its exports have no types."""

_ROW: Final = 13
"""Numbers of a body: x, y, z, i, j, k, w, velocity and spin."""
_ORDER: Final = (0, 1, 2, 6, 3, 4, 5, *range(7, _ROW))
"""Their places in the order of `Engine.rows`."""
_PAGES: Final = 2048
_HANDLES, _LIST, _RESULTS = 0, 8 << 20, 16 << 20
"""Places of the memory that is shared: handles, those that a call lists, and what is read."""
_COLLISIONS, _MEETINGS = 15, 60975
"""Pairs of bodies that may touch: all but those of which none is dynamic, or all."""
_ALL: Final = 0xFFFFFFFF
_SETS: Final = (
    *("integrationparameters", "islandmanager", "broadphase", "narrowphase", "rigidbodyset"),
    *("colliderset", "softbodyset", "impulsejointset", "multibodyjointset", "ccdsolver"),
)
"""The parts of a space, in the order in which a step takes them."""

_ANSWERS: Final = {
    # A number of a vector, for an array that is an address here.
    "set_index": "(f32.store (i32.add (local.get 0) (i32.shl (local.get 1) (i32.const 2)))"
    " (local.get 2))",
    # A handle on its way to a function, which is a list here.
    "generic": "(f64.store (global.get $end) (local.get 0))"
    " (global.set $end (i32.add (global.get $end) (i32.const 8))) (i32.const 0)",
}
_HOST: Final = """(module
  (memory (export "memory") {pages})
  (global $end (export "end") (mut i32) (i32.const 0))
  {functions})"""
_READER: Final = """(module
  (import "host" "memory" (memory 1))
  (import "host" "end" (global $end (mut i32)))
  (import "rapier" "rawrigidbodyset_rbTranslation" (func $place (param i32 f64 i32)))
  (import "rapier" "rawrigidbodyset_rbRotation" (func $turn (param i32 f64 i32)))
  (import "rapier" "rawrigidbodyset_rbLinvel" (func $velocity (param i32 f64 i32)))
  (import "rapier" "rawrigidbodyset_rbAngvel" (func $spin (param i32 f64 i32)))
  (import "rapier" "rawrigidbodyset_rbIsEnabled" (func $enabled (param i32 f64) (result i32)))
  (import "rapier" "rawislandmanager_forEachActiveRigidBodyHandle" (func $each (param i32 i32)))
  (import "rapier" "rawnarrowphase_contact_pairs_with" (func $others (param i32 f64 i32)))
  (import "rapier" "rawnarrowphase_contact_pair" (func $pair (param i32 f64 f64) (result i32)))
  (import "rapier" "rawnarrowphase_intersection_pairs_with"
    (func $within (param i32 f64 i32)))
  (import "rapier" "rawnarrowphase_intersection_pair"
    (func $overlap (param i32 f64 f64) (result i32)))
  (import "rapier" "rawcontactpair_numContactManifolds" (func $manifolds (param i32) (result i32)))
  (import "rapier" "rawcontactpair_contactManifold"
    (func $manifold (param i32 i32) (result i32)))
  (import "rapier" "rawcontactmanifold_num_solver_contacts"
    (func $solved (param i32) (result i32)))
  (import "rapier" "rawcontactmanifold_num_contacts" (func $points (param i32) (result i32)))
  (import "rapier" "rawcontactmanifold_contact_impulse"
    (func $impulse (param i32 i32) (result f32)))
  (import "rapier" "__wbg_rawcontactmanifold_free" (func $free_manifold (param i32 i32)))
  (import "rapier" "__wbg_rawcontactpair_free" (func $free_pair (param i32 i32)))
  (func (export "awake") (param $islands i32) (param $to i32) (result i32)
    (global.set $end (local.get $to))
    (call $each (local.get $islands) (i32.const 0))
    (i32.shr_u (i32.sub (global.get $end) (local.get $to)) (i32.const 3)))
  (func (export "rows") (param $bodies i32) (param $from i32) (param $count i32) (param $to i32)
    (local $body f64)
    (loop $next
      (if (local.get $count) (then
        (local.set $body (f64.load (local.get $from)))
        (call $place (local.get $bodies) (local.get $body) (local.get $to))
        (call $turn (local.get $bodies) (local.get $body) (i32.add (local.get $to) (i32.const 12)))
        (call $velocity
          (local.get $bodies) (local.get $body) (i32.add (local.get $to) (i32.const 28)))
        (call $spin (local.get $bodies) (local.get $body) (i32.add (local.get $to) (i32.const 40)))
        (local.set $from (i32.add (local.get $from) (i32.const 8)))
        (local.set $to (i32.add (local.get $to) (i32.const 52)))
        (local.set $count (i32.sub (local.get $count) (i32.const 1)))
        (br $next)))))
  (func (export "disabled") (param $bodies i32) (param $islands i32) (param $from i32)
    (param $to i32) (result i32)
    (local $begin i32)
    (local.set $begin (local.get $to))
    (global.set $end (local.get $from))
    (call $each (local.get $islands) (i32.const 0))
    (loop $next
      (if (i32.lt_u (local.get $from) (global.get $end)) (then
        (if (i32.eqz (call $enabled (local.get $bodies) (f64.load (local.get $from)))) (then
          (f64.store (local.get $to) (f64.load (local.get $from)))
          (local.set $to (i32.add (local.get $to) (i32.const 8)))))
        (local.set $from (i32.add (local.get $from) (i32.const 8)))
        (br $next))))
    (i32.shr_u (i32.sub (local.get $to) (local.get $begin)) (i32.const 3)))
  (func (export "overlaps") (param $narrow i32) (param $from i32) (param $count i32)
    (param $list i32) (param $to i32) (result i32)
    (local $at i32) (local $begin i32)
    (local.set $begin (local.get $to))
    (loop $next
      (if (local.get $count) (then
        (local.set $at (local.get $list))
        (global.set $end (local.get $list))
        (call $within (local.get $narrow) (f64.load (local.get $from)) (i32.const 0))
        (loop $other
          (if (i32.lt_u (local.get $at) (global.get $end)) (then
            (if (call $overlap
                (local.get $narrow) (f64.load (local.get $from)) (f64.load (local.get $at)))
              (then
                (f64.store (local.get $to) (f64.load (local.get $from)))
                (f64.store offset=8 (local.get $to) (f64.load (local.get $at)))
                (local.set $to (i32.add (local.get $to) (i32.const 16)))))
            (local.set $at (i32.add (local.get $at) (i32.const 8)))
            (br $other))))
        (local.set $from (i32.add (local.get $from) (i32.const 8)))
        (local.set $count (i32.sub (local.get $count) (i32.const 1)))
        (br $next))))
    (i32.shr_u (i32.sub (local.get $to) (local.get $begin)) (i32.const 4)))
  (func (export "contacts") (param $narrow i32) (param $from i32) (param $count i32)
    (param $list i32) (param $to i32) (result i32)
    (local $solid f64) (local $other f64) (local $at i32) (local $pair i32) (local $manifold i32)
    (local $left i32) (local $points i32) (local $active i32) (local $impulse f64)
    (local $begin i32)
    (local.set $begin (local.get $to))
    (loop $next
      (if (local.get $count) (then
        (local.set $solid (f64.load (local.get $from)))
        (local.set $at (local.get $list))
        (global.set $end (local.get $list))
        (call $others (local.get $narrow) (local.get $solid) (i32.const 0))
        (loop $other
          (if (i32.lt_u (local.get $at) (global.get $end)) (then
            (local.set $other (f64.load (local.get $at)))
            (local.set $at (i32.add (local.get $at) (i32.const 8)))
            (br_if $other (i64.ge_u  ;; Each pair is listed by both.
              (i64.reinterpret_f64 (local.get $solid)) (i64.reinterpret_f64 (local.get $other))))
            (local.set $pair
              (call $pair (local.get $narrow) (local.get $solid) (local.get $other)))
            (local.set $left (call $manifolds (local.get $pair)))
            (local.set $active (i32.const 0))
            (local.set $impulse (f64.const 0))
            (loop $each
              (if (local.get $left) (then
                (local.set $left (i32.sub (local.get $left) (i32.const 1)))
                (local.set $manifold (call $manifold (local.get $pair) (local.get $left)))
                (local.set $active (i32.or (local.get $active)
                  (call $solved (local.get $manifold))))
                (local.set $points (call $points (local.get $manifold)))
                (loop $point
                  (if (local.get $points) (then
                    (local.set $points (i32.sub (local.get $points) (i32.const 1)))
                    (local.set $impulse (f64.add (local.get $impulse) (f64.promote_f32
                      (call $impulse (local.get $manifold) (local.get $points)))))
                    (br $point))))
                (call $free_manifold (local.get $manifold) (i32.const 1))
                (br $each))))
            (call $free_pair (local.get $pair) (i32.const 1))
            (if (local.get $active) (then
              (f64.store (local.get $to) (local.get $solid))
              (f64.store offset=8 (local.get $to) (local.get $other))
              (f64.store offset=16 (local.get $to) (local.get $impulse))
              (local.set $to (i32.add (local.get $to) (i32.const 24)))))
            (br $other))))
        (local.set $from (i32.add (local.get $from) (i32.const 8)))
        (local.set $count (i32.sub (local.get $count) (i32.const 1)))
        (br $next))))
    (i32.div_u (i32.sub (local.get $to) (local.get $begin)) (i32.const 24))))"""


_ALONG_Z: Final = Rigid(w=0.5**0.5, i=0.5**0.5)


def read_code() -> bytes:
    """The file, below the folder of Python's environment. Raises BodiesError for another one."""
    path = Path(sys.prefix, "node_modules", PACKAGE, "rapier_wasm3d_bg.wasm")
    how = f"run: npm install --prefix {sys.prefix} {PACKAGE}@{VERSION}"
    try:
        code = path.read_bytes()
    except OSError as error:
        raise BodiesError(f"the engine wasm: {error.strerror} ({path}); {how}") from None
    if hashlib.sha256(code).hexdigest() != DIGEST:
        raise BodiesError(f"the engine wasm: {path} is not that of version {VERSION}; {how}")
    return code


@lru_cache(maxsize=1)
def _compiled() -> tuple[Any, Any]:
    """The file, compiled; wasmtime keeps the result for later runs. Raises BodiesError."""
    code = read_code()
    config = library.Config()
    config.cache = True
    # The only numbers that WebAssembly leaves to the processor are those that are none.
    config.cranelift_nan_canonicalization = True
    engine = library.Engine(config)
    return engine, library.Module(engine, code)


class _Contact(NamedTuple):
    """Two solids that touch."""

    collider1: float
    collider2: float
    impulse: float
    has_any_active_contact: bool = True

    def total_impulse_magnitude(self) -> float:
        return self.impulse


class _Rapier:
    """An instance of the file."""

    def __init__(self) -> None:
        engine, module = _compiled()
        self._store = library.Store(engine)
        host = library.Instance(self._store, library.Module(engine, _host(module)), [])
        self._shared = host.exports(self._store)["memory"]
        answers = host.exports(self._store)
        instance = library.Instance(
            self._store,
            module,
            [
                library.Func(self._store, wanted.type, self._panic)
                if "throw" in wanted.name
                else answers[wanted.name]
                for wanted in module.imports
            ],
        )
        self._exports = instance.exports(self._store)
        self._memory = self._exports["memory"]
        reader = library.Module(engine, library.wat2wasm(_READER))
        given = {"host": answers, "rapier": self._exports}
        imported = [given[wanted.module][wanted.name] for wanted in reader.imports]
        self._reader = library.Instance(self._store, reader, imported).exports(self._store)

    def __call__(self, name: str, *arguments: Any) -> Any:
        made, given = list[tuple[str, int]](), list[Any]()
        for argument in arguments:
            if isinstance(argument, tuple):
                numbers: list[Any] = [*cast("tuple[Any, ...]", argument)]
                kind = "vector" if len(numbers) == 3 else "rotation"
                address = self._exports[f"raw{kind}_new"](self._store, *map(float, numbers))
                made.append((kind, address))
                given.append(address)
            else:
                given.append(argument)
        try:
            result = self._exports[f"raw{name}"](self._store, *given)
        except (library.Trap, library.WasmtimeError) as error:
            raise BodiesError(f"Rapier: {name} failed: {str(error).splitlines()[-1]}") from None
        for kind, address in made:
            self.free(kind, address)
        return result

    def array(self, values: ArrayLike, dtype: str) -> tuple[int, int]:
        """Address and length of an array that the function which takes it will free."""
        data = np.asarray(values, dtype).ravel()
        address = self._exports["__wbindgen_export3"](self._store, data.nbytes, data.itemsize)
        self._memory.write(self._store, data.tobytes(), address)
        return address, data.size

    def vector(self, name: str, *arguments: Any) -> tuple[float, ...]:
        """Three numbers that a function writes."""
        self(name, *arguments, _RESULTS)
        return tuple(self._read(3, "<f4").tolist())

    def awake(self, islands: int) -> NDArray[np.float64]:
        """Handles of the bodies that are awake."""
        return self._read(self._reader["awake"](self._store, islands, _RESULTS), "<f8")

    def disabled(self, bodies: int, islands: int) -> NDArray[np.float64]:
        """Handles of the bodies that a step has disabled, because their state is no number."""
        reader = self._reader["disabled"]
        return self._read(reader(self._store, bodies, islands, _LIST, _RESULTS), "<f8")

    def rows(self, bodies: int, handles: Sequence[float] | NDArray[np.float64]) -> NDArray[Any]:
        """The state of bodies, 32-bit numbers in the order of `_ROW`."""
        count = len(handles)
        self._shared.write(self._store, np.asarray(handles, "<f8").tobytes(), _HANDLES)
        self._reader["rows"](self._store, bodies, _HANDLES, count, _RESULTS)
        return self._read(count * _ROW, "<f4").reshape(count, _ROW)

    def contacts(self, narrow: int, solids: Sequence[float]) -> list[_Contact]:
        """Pairs of solids that touch."""
        self._shared.write(self._store, np.asarray(solids, "<f8").tobytes(), _HANDLES)
        count = self._reader["contacts"](
            self._store, narrow, _HANDLES, len(solids), _LIST, _RESULTS
        )
        return [_Contact(*row) for row in self._read(3 * count, "<f8").reshape(count, 3).tolist()]

    def overlaps(self, narrow: int, sensors: Sequence[float]) -> list[tuple[float, float, bool]]:
        """Pairs of a sensor and what is within it; those of two sensors twice."""
        self._shared.write(self._store, np.asarray(sensors, "<f8").tobytes(), _HANDLES)
        count = self._reader["overlaps"](
            self._store, narrow, _HANDLES, len(sensors), _LIST, _RESULTS
        )
        pairs = self._read(2 * count, "<f8").reshape(count, 2).tolist()
        return [(first, second, True) for first, second in pairs]

    def stack(self, size: int) -> int:
        """The address of the stack after it has grown downwards by a negative number of bytes."""
        address: int = self._exports["__wbindgen_add_to_stack_pointer"](self._store, size)
        return address

    def number(self, address: int) -> float:
        """A 64-bit number in Rapier's memory."""
        data = bytes(self._memory.read(self._store, address, address + 8))
        return float(np.frombuffer(data, "<f8")[0])

    def free(self, kind: str, address: int) -> None:
        """Give memory back."""
        self._exports[f"__wbg_raw{kind}_free"](self._store, address, 1)

    def _read(self, count: int, dtype: str) -> NDArray[Any]:
        end = _RESULTS + count * np.dtype(dtype).itemsize
        return np.frombuffer(bytes(self._shared.read(self._store, _RESULTS, end)), dtype)

    def _panic(self, start: int, length: int) -> None:
        text = bytes(self._memory.read(self._store, start, start + length))
        raise BodiesError(f"Rapier: {text.decode('utf-8', 'replace'):.200}")


def _host(module: Any) -> bytes:
    """A module with an answer to each import; most are asked only for what is not used here."""
    functions = list[str]()
    for wanted in module.imports:
        short = re.sub(r"^__wb(?:g|indgen)_|_[0-9a-f]{16}$", "", wanted.name)
        params = " ".join(map(str, wanted.type.params))
        result = "".join(map(str, wanted.type.results))
        answer = _ANSWERS.get(short, f"({result}.const 0)" if result else "")
        functions.append(
            f'(func (export "{wanted.name}") (param {params})'
            f" {f'(result {result})' if result else ''} {answer})"
        )
    text: bytes = library.wat2wasm(_HOST.format(pages=_PAGES, functions="\n  ".join(functions)))
    return text


# --- the names of rapier3d ------------------------------------------------------------------------


class _Numbers(tuple[float, ...]):
    """A vector x, y, z or a rotation i, j, k, w."""

    __slots__ = ()

    def to_tuple(self) -> tuple[float, ...]:
        return tuple(self)


class _Handle(float):
    """A body: the lower 32 bits are its index, the upper ones how often that has been used."""

    @property
    def index(self) -> int:
        return int(np.float64(self).view(np.uint64)) & _ALL


class _Pose(NamedTuple):
    """A translation and a rotation."""

    translation: Sequence[float]
    rotation: _Numbers


def _rotation(w: float, i: float, j: float, k: float) -> _Numbers:
    """A quaternion in the order of Rapier."""
    return _Numbers((i, j, k, w))


class _Description:
    """What a chain of calls describes, such as `Collider.ball(1.0).density(3.0)`."""

    def __init__(self, kind: Any, *sizes: Any) -> None:
        self.kind, self.sizes, self.calls = kind, sizes, list[tuple[str, Any]]()

    def __getattr__(self, name: str) -> Any:
        def note(*values: Any) -> _Description:
            self.calls.append((name, values[0] if len(values) == 1 else values))
            return self

        return note

    def build(self) -> _Description:
        return self


class _Groups(NamedTuple):
    """Groups of a solid, and groups that it meets, as bits; this build has 16 of them."""

    own: int = _ALL
    met: int = _ALL

    @staticmethod
    def all() -> _Groups:
        return _Groups()

    @property
    def bits(self) -> int:
        """Raises BodiesError for a group that this build does not have."""
        if self.own != _ALL and self.own > 0xFFFF:
            raise BodiesError(
                f"group {self.own.bit_length() - 1}; the engine wasm has 1 to 15, and 0 for none"
            )
        both = (self.own & 0xFFFF) << 16 | self.met & 0xFFFF
        # WebAssembly's numbers have no sign, and their interface here has.
        return both - (1 << 32) if both >> 31 else both


class _Body:
    """A body where it is now."""

    def __init__(self, world: _Space, handle: float) -> None:
        self._world, self._handle = world, handle
        self.add_force = partial(self._act, "rbAddForce")
        self.add_torque = partial(self._act, "rbAddTorque")
        self.apply_impulse = partial(self._act, "rbApplyImpulse")
        self.apply_torque_impulse = partial(self._act, "rbApplyTorqueImpulse")
        self.reset_forces = partial(self._call, "rbResetForces")
        self.reset_torques = partial(self._call, "rbResetTorques")
        self.wake_up = partial(self._call, "rbWakeUp")
        self.recompute_mass_properties_from_colliders = partial(
            self._call, "rbRecomputeMassPropertiesFromColliders"
        )

    def _call(self, name: str, *arguments: Any) -> Any:
        world = self._world
        return world.rapier(
            f"rigidbodyset_{name}", world.sets["rigidbodyset"], self._handle, *arguments
        )

    def _act(self, name: str, vector: tuple[float, ...]) -> None:
        self._call(name, vector, True)

    def _row(self) -> list[float]:
        world = self._world
        row: list[float] = world.rapier.rows(world.sets["rigidbodyset"], [self._handle])[0].tolist()
        return row

    @property
    def position(self) -> _Pose:
        row = self._row()
        return _Pose(_Numbers(row[:3]), _Numbers(row[3:7]))

    @property
    def linvel(self) -> _Numbers:
        return _Numbers(self._row()[7:10])

    @linvel.setter
    def linvel(self, vector: tuple[float, ...]) -> None:
        self._act("rbSetLinvel", vector)

    @property
    def angvel(self) -> _Numbers:
        return _Numbers(self._row()[10:])

    @angvel.setter
    def angvel(self, vector: tuple[float, ...]) -> None:
        self._act("rbSetAngvel", vector)

    @property
    def is_sleeping(self) -> bool:
        return bool(self._call("rbIsSleeping"))

    @property
    def body_type(self) -> int:
        return int(self._call("rbBodyType"))

    @body_type.setter
    def body_type(self, kind: int) -> None:
        self._call("rbSetBodyType", kind, True)

    @property
    def colliders(self) -> list[float]:
        return [self._call("rbCollider", at) for at in range(self._call("rbNumColliders"))]

    def velocity_at_point(self, point: tuple[float, ...]) -> _Numbers:
        world = self._world
        bodies = world.sets["rigidbodyset"]
        return _Numbers(
            world.rapier.vector("rigidbodyset_rbVelocityAtPoint", bodies, self._handle, point)
        )

    def set_next_kinematic_position(self, pose: _Pose) -> None:
        self._call("rbSetNextKinematicTranslation", *map(float, pose.translation))
        self._call("rbSetNextKinematicRotation", *map(float, pose.rotation))


class _Bodies:
    """Bodies by their handles."""

    def __init__(self, world: _Space) -> None:
        self._world = world

    def __getitem__(self, handle: float) -> _Body:
        return _Body(self._world, handle)


class _Joints:
    """Joints between bodies."""

    def __init__(self, world: _Space) -> None:
        self._world = world

    def _call(self, name: str, *arguments: Any) -> Any:
        world = self._world
        return world.rapier(f"impulsejointset_{name}", world.sets["impulsejointset"], *arguments)

    def insert(self, first: float, second: float, joint: _Description) -> float:
        origin, along = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)
        made = self._world.rapier("genericjoint_generic", origin, origin, along, joint.kind)
        handle: float = self._call("createJoint", made, first, second, True)
        self._world.rapier.free("genericjoint", made)
        for name, values in joint.calls:
            function = {
                "local_frame1": "jointSetLocalFrame1",
                "local_frame2": "jointSetLocalFrame2",
                "limits": "jointSetLimits",
                "motor": "jointConfigureMotor",
                "motor_model": "jointConfigureMotorModel",
                "contacts_enabled": "jointSetContactsEnabled",
            }[name]
            if isinstance(values, _Pose):
                values = [tuple(part) for part in values]
            self._call(function, handle, *(values if isinstance(values, Sequence) else [values]))
        return handle

    def remove(self, handle: float) -> None:
        self._call("remove", handle, True)


class _Space:
    """A space of bodies, solids and joints."""

    def __init__(self, gravity: tuple[float, float, float]) -> None:
        self.rapier = _Rapier()
        self.sets: dict[str, int] = {name: self.rapier(f"{name}_new") for name in _SETS}
        self._gravity = self.rapier("vector_new", *map(float, gravity))
        self._pipeline = self.rapier("physicspipeline_new")
        self.colliders = self.sets["colliderset"]
        self.rigid_bodies, self.impulse_joints = _Bodies(self), _Joints(self)
        self.integration_parameters = SimpleNamespace(dt=0.0)
        self.narrow_phase = SimpleNamespace(
            contact_pairs=self._contacts, intersection_pairs=self._overlaps
        )
        self._solids = dict[float, bool]()  # Whether they are sensors.
        self.quarantine = SimpleNamespace(bodies=list[_Handle]())

    def set_num_threads(self, threads: int) -> None:
        """WebAssembly has one; results do not depend on them."""

    def step(self) -> None:
        self.rapier(
            "integrationparameters_set_dt",
            self.sets["integrationparameters"],
            self.integration_parameters.dt,
        )
        self.rapier("physicspipeline_step", self._pipeline, self._gravity, *self.sets.values())
        bodies, islands = self.sets["rigidbodyset"], self.sets["islandmanager"]
        self.quarantine.bodies = [*map(_Handle, self.rapier.disabled(bodies, islands))]

    def _contacts(self) -> list[_Contact]:
        return self.rapier.contacts(self.sets["narrowphase"], list(self._solids))

    def _overlaps(self) -> list[tuple[float, float, bool]]:
        sensors = [solid for solid, is_sensor in self._solids.items() if is_sensor]
        return self.rapier.overlaps(self.sets["narrowphase"], sensors)

    def active_bodies(self) -> list[_Handle]:
        return [*map(_Handle, self.rapier.awake(self.sets["islandmanager"]))]

    def add_body(self, body: _Description) -> _Handle:
        given = dict(body.calls)
        zero, unturned, pose = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), given["position"]
        velocity, spin = given.get("linvel", zero), given.get("angvel", zero)
        # Its centre and inertia are those of its solids; it moves and turns along all axes.
        mass = (0.0, False, zero, velocity, spin, zero, unturned)
        sleeps = given.get("can_sleep", True), given.get("sleeping", False)
        handle = self.rapier(
            "rigidbodyset_createRigidBody",
            *(self.sets["rigidbodyset"], True, tuple(pose.translation), tuple(pose.rotation), 1.0),
            *(*mass, *[True] * 6, 0.0, 0.0, body.kind, *sleeps, 0.0, False, 0, 0, 0),
        )
        return _Handle(handle)

    def remove_body(self, handle: float) -> None:
        for solid in self.rigid_bodies[handle].colliders:
            del self._solids[solid]
        names = ("islandmanager", "colliderset", "softbodyset")
        names += ("impulsejointset", "multibodyjointset")
        others = [self.sets[name] for name in names]
        self.rapier("rigidbodyset_remove", self.sets["rigidbodyset"], handle, *others)

    def add_collider(self, solid: _Description, body: float) -> float:
        given, zero, unturned = dict(solid.calls), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
        shape, (place, turn) = self._shape(solid), given["position"]
        if solid.kind == "capsule":  # Rapier's are along y.
            i, j, k, w = turn
            turn = Rigid(0.0, 0.0, 0.0, w, i, j, k).then(_ALONG_Z)
            turn = (turn.i, turn.j, turn.k, turn.w)
        groups = given["collision_groups"].bits
        # Its mass follows from its density; it meets all but fixed bodies among themselves.
        mass = (0, 0.0, zero, zero, unturned, float(given["density"]))
        surface = (float(given["friction"]), float(given["restitution"]), 0, 0, given["sensor"])
        to = self.rapier.stack(-16)
        self.rapier(
            "colliderset_createCollider",
            *(to, self.colliders, True, shape, tuple(place), tuple(turn)),
            *(*mass, *surface, groups, -1, given["active_collision_types"], 0, 0, 0.0, 0.0),
            *(True, body, self.sets["rigidbodyset"]),
        )
        handle = self.rapier.number(to + 8)
        self.rapier.stack(16)
        self.rapier.free("shape", shape)
        self._solids[handle] = bool(given["sensor"])
        return handle

    def _shape(self, solid: _Description) -> int:
        """The address of a shape. Raises BodiesError for points without volume."""
        name, arguments = solid.kind, [*solid.sizes]
        if name == "convex_hull":
            name, arguments = "convexHull", [*self.rapier.array(solid.sizes[0], "<f4")]
        elif name == "trimesh":
            points, triangles = solid.sizes
            arguments = [*self.rapier.array(points, "<f4"), *self.rapier.array(triangles, "<u4"), 0]
        shape: int = self.rapier(f"shape_{name}", *arguments)
        if not shape:
            raise BodiesError(f"{solid.kind}: its points have no volume")
        return shape

    def remove_collider(self, handle: float) -> None:
        others = [self.sets[name] for name in ("islandmanager", "rigidbodyset", "softbodyset")]
        del self._solids[handle]
        self.rapier("colliderset_remove", self.colliders, handle, *others, True)


_DYNAMIC, _FIXED, _KINEMATIC = 0, 1, 2
_SHAPES: Final = ("cuboid", "ball", "cylinder", "cone", "trimesh", "convex_hull")


class WasmEngine(Engine):
    """Bodies by the ids of their agents, with the same bits on every processor."""

    library = SimpleNamespace(
        PhysicsWorld=_Space,
        RigidBody=SimpleNamespace(
            dynamic=partial(_Description, _DYNAMIC),
            fixed=partial(_Description, _FIXED),
            kinematic_position_based=partial(_Description, _KINEMATIC),
        ),
        RigidBodyType=SimpleNamespace(
            DYNAMIC=_DYNAMIC, FIXED=_FIXED, KINEMATIC_POSITION_BASED=_KINEMATIC
        ),
        Collider=SimpleNamespace(
            **{kind: partial(_Description, kind) for kind in _SHAPES},
            capsule_z=partial(_Description, "capsule"),
        ),
        Isometry3=_Pose,
        Rotation3=_rotation,
        InteractionGroups=_Groups,
        ActiveCollisionTypes=SimpleNamespace(
            all=lambda: _MEETINGS, default_types=lambda: _COLLISIONS
        ),
        Group=SimpleNamespace(from_bits=int),
        GenericJointBuilder=_Description,
        JointAxis=SimpleNamespace(LIN_X=0, ANG_X=3, ANG_Y=4, ANG_Z=5),
        JointAxesMask=SimpleNamespace(
            LOCKED_FIXED_AXES=0b111111,
            LOCKED_REVOLUTE_AXES=0b110111,
            LOCKED_PRISMATIC_AXES=0b111110,
            LOCKED_SPHERICAL_AXES=0b000111,
        ),
        MotorModel=SimpleNamespace(FORCE_BASED=1),
    )

    def rows(self, names: Sequence[str]) -> NDArray[np.float64]:
        world: _Space = self._world
        words = world.rapier.rows(world.sets["rigidbodyset"], [self.bodies[name] for name in names])
        return words[:, _ORDER].astype(np.float64)
