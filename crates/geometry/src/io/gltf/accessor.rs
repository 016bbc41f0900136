//! Accessors: numbers in buffers, read without trusting a single field.

use super::{Reader, item};
use crate::io::ImportError;
use ::gltf::json::accessor::{Accessor, ComponentType, Type};
use ::gltf::json::validation::Checked;

/// How the values of an accessor lie in memory.
struct Layout<'a> {
    /// `None` stands for zeros.
    bytes: Option<&'a [u8]>,
    stride: usize,
    count: usize,
    component: ComponentType,
    normalised: bool,
}

fn components(kind: Type) -> usize {
    match kind {
        Type::Scalar => 1,
        Type::Vec2 => 2,
        Type::Vec3 => 3,
        Type::Vec4 | Type::Mat2 => 4,
        Type::Mat3 => 9,
        Type::Mat4 => 16,
    }
}

fn size(component: ComponentType) -> usize {
    match component {
        ComponentType::I8 | ComponentType::U8 => 1,
        ComponentType::I16 | ComponentType::U16 => 2,
        ComponentType::U32 | ComponentType::F32 => 4,
    }
}

/// The value of the first component in `bytes`, which must be long enough.
fn value(bytes: &[u8], component: ComponentType, normalised: bool) -> f32 {
    let b = |i: usize| bytes.get(i).copied().unwrap_or(0);
    let (value, largest) = match component {
        ComponentType::I8 => (f32::from(b(0) as i8), 127.0),
        ComponentType::U8 => (f32::from(b(0)), 255.0),
        ComponentType::I16 => (f32::from(i16::from_le_bytes([b(0), b(1)])), 32_767.0),
        ComponentType::U16 => (f32::from(u16::from_le_bytes([b(0), b(1)])), 65_535.0),
        ComponentType::U32 => (u32::from_le_bytes([b(0), b(1), b(2), b(3)]) as f32, 4_294_967_295.0),
        ComponentType::F32 => return f32::from_le_bytes([b(0), b(1), b(2), b(3)]),
    };
    if normalised { (value / largest).max(-1.0) } else { value }
}

fn unsigned(bytes: &[u8], component: ComponentType) -> u32 {
    let b = |i: usize| bytes.get(i).copied().unwrap_or(0);
    match component {
        ComponentType::U8 | ComponentType::I8 => u32::from(b(0)),
        ComponentType::U16 | ComponentType::I16 => u32::from(u16::from_le_bytes([b(0), b(1)])),
        _ => u32::from_le_bytes([b(0), b(1), b(2), b(3)]),
    }
}

impl Reader<'_> {
    pub(super) fn accessor(&self, index: usize) -> Result<&Accessor, ImportError> {
        item(&self.root.accessors, index, "accessor")
    }

    /// Number of components of each value.
    pub(super) fn arity(&self, index: usize) -> Result<usize, ImportError> {
        match self.accessor(index)?.type_ {
            Checked::Valid(kind) => Ok(components(kind)),
            Checked::Invalid => Err(bad(index, "unknown type")),
        }
    }

    /// Vectors of `N` components; `make` turns each into what is wanted.
    pub(super) fn vectors<const N: usize, T>(
        &mut self,
        index: usize,
        make: impl Fn([f32; N]) -> T,
    ) -> Result<Vec<T>, ImportError> {
        if self.arity(index)? != N {
            return Err(bad(index, format!("{N} components are needed")));
        }
        let count = self.count_within_budget(index, size_of::<T>())?;
        let layout = self.layout(index, N)?;
        let mut out = Vec::with_capacity(count);
        match layout.bytes {
            None => out.extend((0..count).map(|_| make([0.0; N]))),
            Some(bytes) => {
                let width = size(layout.component);
                let (component, normalised) = (layout.component, layout.normalised);
                if component == ComponentType::F32 {
                    // A loop of its own for the common case.
                    out.extend(elements(bytes, layout.stride, N * 4, count).map(|element| {
                        let words = element.as_chunks::<4>().0;
                        make(std::array::from_fn(|i| f32::from_le_bytes(words[i])))
                    }));
                } else {
                    out.extend(elements(bytes, layout.stride, N * width, count).map(|element| {
                        make(std::array::from_fn(|i| value(&element[i * width..], component, normalised)))
                    }));
                }
            }
        }
        self.each_sparse(index, N, |at, bytes| {
            let width = size(layout.component);
            out[at] = make(std::array::from_fn(|i| {
                value(&bytes[i * width..], layout.component, layout.normalised)
            }));
        })?;
        Ok(out)
    }

    /// Unsigned whole numbers.
    pub(super) fn indices(&mut self, index: usize) -> Result<Vec<u32>, ImportError> {
        if self.arity(index)? != 1 {
            return Err(bad(index, "indices must be scalars"));
        }
        let count = self.count_within_budget(index, 4)?;
        let layout = self.layout(index, 1)?;
        let component = layout.component;
        if !matches!(component, ComponentType::U8 | ComponentType::U16 | ComponentType::U32) {
            return Err(bad(index, "indices must be unsigned whole numbers"));
        }
        let mut out: Vec<u32> = match layout.bytes {
            None => vec![0; count],
            Some(bytes) => elements(bytes, layout.stride, size(component), count)
                .map(|e| unsigned(e, component))
                .collect(),
        };
        self.each_sparse(index, 1, |at, bytes| out[at] = unsigned(bytes, component))?;
        Ok(out)
    }

    fn count_within_budget(&mut self, index: usize, bytes_each: usize) -> Result<usize, ImportError> {
        let count = self.accessor(index)?.count.0;
        self.budget.take(count.saturating_mul(bytes_each as u64))?;
        Ok(count as usize)
    }

    fn layout(&self, index: usize, arity: usize) -> Result<Layout<'_>, ImportError> {
        let accessor = self.accessor(index)?;
        let Checked::Valid(component) = accessor.component_type else {
            return Err(bad(index, "unknown component type"));
        };
        let component = component.0;
        let element = arity * size(component);
        let count = accessor.count.0 as usize;
        let mut layout =
            Layout { bytes: None, stride: element, count, component, normalised: accessor.normalized };
        let Some(view) = accessor.buffer_view else { return Ok(layout) };
        let (bytes, view) = self.buffers.view(self.root, view.value())?;
        layout.stride = view.byte_stride.as_ref().map_or(element, |s| s.0);
        if layout.stride < element {
            return Err(bad(index, format!("a stride of {} for {element} bytes", layout.stride)));
        }
        let offset = accessor.byte_offset.map_or(0, |o| o.0);
        layout.bytes = Some(range(bytes, offset, layout.stride, element, layout.count).ok_or_else(|| {
            let problem =
                format!("{count} values do not fit in the {} bytes of its buffer view", bytes.len());
            bad(index, problem)
        })?);
        Ok(layout)
    }

    /// Calls `set` with the place and the bytes of every value that a sparse accessor replaces.
    fn each_sparse(
        &self,
        index: usize,
        arity: usize,
        mut set: impl FnMut(usize, &[u8]),
    ) -> Result<(), ImportError> {
        let accessor = self.accessor(index)?;
        let (Some(sparse), Checked::Valid(component)) = (&accessor.sparse, accessor.component_type) else {
            return Ok(());
        };
        let Checked::Valid(places) = sparse.indices.component_type else {
            return Err(bad(index, "unknown type of sparse indices"));
        };
        let (count, place_size, element) = (sparse.count.0, size(places.0), arity * size(component.0));
        let outside = || bad(index, "its sparse values leave their buffer view");
        let count = usize::try_from(count).map_err(|_| outside())?;
        let (place_bytes, _) = self.buffers.view(self.root, sparse.indices.buffer_view.value())?;
        let place_bytes = range(place_bytes, sparse.indices.byte_offset.0, place_size, place_size, count);
        let (value_bytes, _) = self.buffers.view(self.root, sparse.values.buffer_view.value())?;
        let value_bytes = range(value_bytes, sparse.values.byte_offset.0, element, element, count);
        let (place_bytes, value_bytes) = place_bytes.zip(value_bytes).ok_or_else(outside)?;
        for (place, value) in place_bytes.chunks_exact(place_size).zip(value_bytes.chunks_exact(element)) {
            let place = u64::from(unsigned(place, places.0));
            if place >= accessor.count.0 {
                return Err(bad(index, format!("sparse value {place} of {}", accessor.count.0)));
            }
            set(place as usize, value);
        }
        Ok(())
    }
}

fn bad(accessor: usize, problem: impl Into<String>) -> ImportError {
    ImportError::syntax(format!("accessor {accessor}"), problem)
}

/// The bytes from `offset` that `count` elements take, if they are there.
fn range(bytes: &[u8], offset: u64, stride: usize, element: usize, count: usize) -> Option<&[u8]> {
    if count == 0 {
        return Some(&[]);
    }
    let start = usize::try_from(offset).ok()?;
    let length = stride.checked_mul(count - 1)?.checked_add(element)?;
    bytes.get(start..start.checked_add(length)?)
}

/// The elements in bytes that [`range`] has cut out.
fn elements(bytes: &[u8], stride: usize, element: usize, count: usize) -> impl Iterator<Item = &[u8]> {
    // The last chunk is short when elements are interleaved with others.
    bytes.chunks(stride).take(count).map(move |chunk| &chunk[..element])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_never_leave_the_bytes() {
        let bytes = [0; 20];
        assert_eq!(range(&bytes, 4, 8, 4, 2).map(<[u8]>::len), Some(12));
        assert_eq!(range(&bytes, 8, 8, 4, 3), None);
        assert_eq!(range(&bytes, u64::MAX, 8, 4, 3), None);
        assert_eq!(range(&bytes, 0, usize::MAX, 4, usize::MAX), None);
        assert_eq!(range(&bytes, u64::MAX, 8, 4, 0), Some(&[][..]));
    }

    #[test]
    fn normalised_values_span_minus_one_to_one() {
        assert_eq!(value(&[0x80], ComponentType::I8, true), -1.0);
        assert_eq!(value(&[0x7f], ComponentType::I8, true), 1.0);
        assert_eq!(value(&[0xff, 0xff], ComponentType::U16, true), 1.0);
        assert_eq!(value(&[0xfe, 0xff], ComponentType::I16, false), -2.0);
        assert_eq!(value(&2.5f32.to_le_bytes(), ComponentType::F32, true), 2.5);
    }
}
