//! How to answer the traversal's queries, by kind of interface.
//!
//! **Answers while drawing** (OpenGL, Direct3D 11, Metal, the software [`DepthBuffer`](crate::DepthBuffer)): hand answers to
//! [`Culler::resolve`](crate::Culler::resolve) whenever they have come, before each [`Culler::next`](crate::Culler::next); on
//! [`Command::Flush`](crate::Command::Flush) wait for one. Use [`Options::default`](crate::Options::default).
//!
//! **Answers after a submit** (wgpu, WebGPU, Vulkan, Direct3D 12): with [`Options::waves`](crate::Options::waves) a frame
//! is a few render passes, and [`Command::Flush`](crate::Command::Flush) ends one. A query set's index is written once per pass,
//! its answers are boolean, and are read after the pass was submitted and a buffer mapped. Shown against stand-ins of
//! wgpu's types, with the calls that wgpu has:
//!
//! ```
//! # use farsight_geometry::{Camera, DAabb, bvh::Bvh, glam::DVec3};
//! use farsight_occlusion::{Answer, Backend, Command, Culler, Hierarchy, Options, Proxy, QueryId, View};
//! # /// Stand-ins that record what they are told; the mock "sees" what lies to the left.
//! # struct Device { sees: fn(&DAabb) -> bool }
//! # struct Pass<'a> { device: &'a Device, results: Vec<u64>, index: Option<usize>, draws: u32 }
//! # impl Device {
//! #     fn begin_render_pass(&self) -> Pass<'_> { Pass { device: self, results: vec![0; 1024], index: None, draws: 0 } }
//! #     fn submit_resolve_and_map(&self, pass: Pass, _queries: u32) -> Vec<u64> { assert!(pass.index.is_none()); pass.results }
//! # }
//! # impl Pass<'_> {
//! #     fn begin_occlusion_query(&mut self, index: u32) { assert!(self.index.replace(index as usize).is_none()); }
//! #     fn end_occlusion_query(&mut self) { self.index.take().expect("a query has begun"); }
//! #     fn draw_leaf(&mut self, _leaf: u32) { self.draws += 1; }
//! #     fn draw_box(&mut self, b: &DAabb) { if (self.device.sees)(b) { self.results[self.index.unwrap()] = 1; } }
//! # }
//!
//! /// Draws a frame; returns the number of passes.
//! fn frame(device: &Device, culler: &mut Culler, scene: &impl Hierarchy, view: View) -> u32 {
//!     culler.begin_frame(view);
//!     let (mut passes, mut pass) = (1, device.begin_render_pass()); // depth and colour: load, store
//!     let mut asked: Vec<QueryId> = Vec::new(); // index in the query set → name
//!     loop {
//!         let command = culler.next(scene);
//!         match command {
//!             Command::Render(leaf) => pass.draw_leaf(leaf.0),
//!             Command::Query { id, node, proxy, .. } => {
//!                 pass.begin_occlusion_query(asked.len() as u32);
//!                 match proxy {
//!                     Proxy::Box(b) => pass.draw_box(&b), // no colour or depth writes, LessEqual
//!                     Proxy::Boxes => culler.boxes().iter().for_each(|b| pass.draw_box(b)),
//!                     Proxy::Geometry => pass.draw_leaf(node.0),
//!                 }
//!                 pass.end_occlusion_query();
//!                 asked.push(id);
//!             }
//!             Command::Flush | Command::Done => {
//!                 // resolve_query_set, copy, submit, map_async, poll. After `Done` do not wait: map in the next frame.
//!                 let finished = std::mem::replace(&mut pass, device.begin_render_pass());
//!                 let answers = device.submit_resolve_and_map(finished, asked.len() as u32);
//!                 for (id, samples) in asked.drain(..).zip(answers) {
//!                     culler.resolve(id, if samples > 0 { Answer::VISIBLE } else { Answer::OCCLUDED });
//!                 }
//!                 if command == Command::Done {
//!                     return passes;
//!                 }
//!                 passes += 1;
//!             }
//!         }
//!     }
//! }
//! # let device = Device { sees: |b| b.min.x < 0.0 };
//! # let boxes: Vec<_> = (-8..8).map(|i| DAabb::from_points([DVec3::new(f64::from(i) * 2.0 + 1.0, 30.0, 0.0)]).inflated(0.5)).collect();
//! # let scene = Bvh::build(&boxes)?;
//! # let view = View::from_camera(&Camera::look_at(DVec3::ZERO, DVec3::Y, DVec3::Z)?);
//! let mut culler = Culler::new(Options::waves(), Backend::Boolean)?;
//! frame(&device, &mut culler, &scene, view); // nothing is known yet: everything is drawn
//! assert_eq!(culler.rendered().len(), 16);
//! let passes = frame(&device, &mut culler, &scene, view);
//! assert_eq!(culler.rendered().len(), 8); // what lies to the left
//! assert!(passes <= 2);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
