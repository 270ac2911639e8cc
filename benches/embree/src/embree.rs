//! The few functions of Embree's C interface that are measured, loaded from a shared object at run time.

use glam::DVec3;
use libloading::Library;
use std::ffi::{CString, c_char, c_int, c_uint, c_void};
use std::ptr::{from_mut, null};

/// `RTCRayHit`: a ray, and room for what it hits in any version 4.
#[repr(C, align(64))]
#[derive(Clone, Copy)]
pub(crate) struct Ray {
    org: [f32; 3],
    near: f32,
    dir: [f32; 3],
    time: f32,
    far: f32,
    mask: u32,
    id: u32,
    flags: u32,
    hit: [u32; 20],
}

/// `RTCRay16`, and room behind it: version 4.4 goes ray by ray, and then reads what each has hit as well.
#[repr(C, align(64))]
#[derive(Clone, Copy)]
pub(crate) struct Ray16 {
    org: [[f32; 16]; 3],
    near: [f32; 16],
    dir: [[f32; 16]; 3],
    time: [f32; 16],
    far: [f32; 16],
    mask: [u32; 16],
    id: [u32; 16],
    flags: [u32; 16],
    hit: [[u32; 16]; 20],
}

/// `RTCOccludedArguments`.
#[repr(C)]
struct Arguments {
    flags: c_uint,
    features: c_uint,
    context: *const c_void,
    filter: *const c_void,
    occluded: *const c_void,
}

/// `RTC_RAY_QUERY_FLAG_COHERENT`.
const COHERENT: c_uint = 1 << 16;
/// Embree knows no surfaces to be skipped: ends on surfaces have to keep off them.
const KEEP_OFF: f32 = 1e-4;

impl Ray {
    pub(crate) fn new([from, to]: [DVec3; 2]) -> Self {
        let (org, dir) = (from.as_vec3().to_array(), (to - from).as_vec3().to_array());
        Self { org, near: 0.0, dir, time: 0.0, far: 1.0, mask: u32::MAX, id: 0, flags: 0, hit: [u32::MAX; 20] }
    }
}

impl Ray16 {
    pub(crate) fn new(from: &[DVec3; 16], to: &[DVec3; 16]) -> Self {
        let axis = |k: usize, of: &dyn Fn(usize) -> DVec3| std::array::from_fn(|ray| of(ray).to_array()[k] as f32);
        Self {
            org: [0, 1, 2].map(|k| axis(k, &|ray| from[ray])),
            near: [KEEP_OFF; 16],
            dir: [0, 1, 2].map(|k| axis(k, &|ray| to[ray] - from[ray])),
            time: [0.0; 16],
            far: [1.0 - KEEP_OFF; 16],
            mask: [u32::MAX; 16],
            id: [0; 16],
            flags: [0; 16],
            hit: [[u32::MAX; 16]; 20],
        }
    }
}

type Handle = *mut c_void;
type Query = unsafe extern "C" fn(Handle, *mut Ray, *const Arguments);
type Query16 = unsafe extern "C" fn(*const c_int, Handle, *mut Ray16, *const Arguments);

/// The shared object, which stays loaded (its threads outlive their devices), and a device that builds on some threads.
pub(crate) struct Embree {
    library: &'static Library,
    device: Handle,
}

/// A committed scene.
pub(crate) struct Scene {
    handle: Handle,
    occluded: Query,
    intersect: Query,
    occluded16: Query16,
}

// SAFETY: queries of a committed scene may run on several threads, says Embree's manual.
unsafe impl Sync for Scene {}

impl Embree {
    pub(crate) fn load(path: &str, threads: usize) -> Result<Self, Box<dyn std::error::Error>> {
        // SAFETY: the file is Embree 4 by the caller's word; its initialisers have no preconditions.
        let library: &Library = Box::leak(Box::new(unsafe { Library::new(path)? }));
        let settings = CString::new(format!("threads={threads}"))?;
        // SAFETY: the signature is that of the manual of version 4; the text outlives the call.
        let device = unsafe {
            library.get::<unsafe extern "C" fn(*const c_char) -> Handle>(b"rtcNewDevice")?(settings.as_ptr())
        };
        if device.is_null() { Err("Embree makes no device".into()) } else { Ok(Self { library, device }) }
    }

    /// A scene of triangles that is not built yet.
    pub(crate) fn scene(&self, triangles: &[[DVec3; 3]], robust: bool) -> Result<Scene, libloading::Error> {
        type Buffer = unsafe extern "C" fn(Handle, c_uint, c_uint, c_uint, usize, usize) -> Handle;
        type Two = unsafe extern "C" fn(Handle, c_uint) -> Handle;
        let count = 3 * triangles.len();
        // SAFETY: the signatures and the order of calls are those of the manual; `rtcSetNewGeometryBuffer` returns room
        // for as many vertices and triples of indices as it was asked for.
        unsafe {
            let get = |name: &[u8]| self.library.get::<Two>(name);
            let one = |name: &[u8]| self.library.get::<unsafe extern "C" fn(Handle) -> Handle>(name);
            let buffer = self.library.get::<Buffer>(b"rtcSetNewGeometryBuffer")?;
            let handle = one(b"rtcNewScene")?(self.device);
            get(b"rtcSetSceneFlags")?(handle, if robust { 4 } else { 0 });
            let geometry = get(b"rtcNewGeometry")?(self.device, 0);
            let vertices = buffer(geometry, 1, 0, 0x9003, 12, count).cast::<[f32; 3]>();
            let indices = buffer(geometry, 0, 0, 0x5003, 12, triangles.len()).cast::<u32>();
            for (k, corner) in triangles.iter().flatten().enumerate() {
                vertices.add(k).write(corner.as_vec3().to_array());
                indices.add(k).write(k as u32);
            }
            one(b"rtcCommitGeometry")?(geometry);
            self.library.get::<unsafe extern "C" fn(Handle, Handle) -> c_uint>(b"rtcAttachGeometry")?(handle, geometry);
            one(b"rtcReleaseGeometry")?(geometry);
            Ok(Scene {
                handle,
                occluded: *self.library.get(b"rtcOccluded1")?,
                intersect: *self.library.get(b"rtcIntersect1")?,
                occluded16: *self.library.get(b"rtcOccluded16")?,
            })
        }
    }

    /// Builds the scene.
    pub(crate) fn commit(&self, scene: &Scene) -> Result<(), libloading::Error> {
        // SAFETY: the signature is that of the manual; the handle is that of a scene.
        unsafe { self.library.get::<unsafe extern "C" fn(Handle)>(b"rtcCommitScene")?(scene.handle) };
        Ok(())
    }

    pub(crate) fn release(&self, scene: &Scene) -> Result<(), libloading::Error> {
        // SAFETY: the signature is that of the manual; the handle is that of a scene and is not used again.
        unsafe { self.library.get::<unsafe extern "C" fn(Handle)>(b"rtcReleaseScene")?(scene.handle) };
        Ok(())
    }
}

impl Scene {
    pub(crate) fn occluded(&self, ray: &mut Ray) -> bool {
        ray.far = 1.0;
        // SAFETY: the scene is committed; the ray has `RTCRay`'s layout and alignment; no arguments are the defaults.
        unsafe { (self.occluded)(self.handle, from_mut(ray), null()) };
        ray.far < 0.0
    }

    pub(crate) fn intersect(&self, ray: &mut Ray) -> bool {
        ray.far = f32::INFINITY;
        // SAFETY: as above; behind the ray is room for `RTCHit`.
        unsafe { (self.intersect)(self.handle, from_mut(ray), null()) };
        ray.far < f32::INFINITY
    }

    /// How many of sixteen segments are blocked.
    pub(crate) fn occluded16(&self, rays: &mut Ray16, coherent: bool) -> u32 {
        rays.far = [1.0 - KEEP_OFF; 16];
        let valid = Valid([-1; 16]);
        let flags = if coherent { COHERENT } else { 0 };
        let arguments = Arguments { flags, features: u32::MAX, context: null(), filter: null(), occluded: null() };
        // SAFETY: as above, with `RTCRay16` and the flags of sixteen rays, aligned to 64 bytes.
        unsafe { (self.occluded16)(valid.0.as_ptr(), self.handle, from_mut(rays), &raw const arguments) };
        rays.far.iter().map(|&far| u32::from(far < 0.0)).sum()
    }
}

#[repr(align(64))]
struct Valid([c_int; 16]);
