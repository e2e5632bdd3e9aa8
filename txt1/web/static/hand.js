// The hand rule of txt1/control/hand.py, by the numbers that /hand tells of the car: two axes become a velocity.

export const DEAD = 0.1  // share of an axis around its middle that counts as none

// An axis, -1 to 1, without its dead middle.
export function shaped(value) {
  const size = Math.min(1, Math.max(0, (Math.abs(value) - DEAD) / (1 - DEAD)))
  return Math.sign(value) * size
}

// Ahead and left are positive; on a wheel, left in reverse turns a car that steers to the right.
export function velocity(hand, speed, ahead, left, wheel = false) {
  const chosen = Math.min(speed, hand.v_max), v = chosen * ahead
  const side = wheel && v < 0 && !hand.pivots ? -left : left
  const omega = side * (hand.pivots ? chosen : Math.abs(v)) / hand.radius
  return { v: v || 0, omega: Math.min(Math.max(omega, -hand.omega_max), hand.omega_max) || 0 }
}

// The other way: where a stick would be, for a velocity at this speed.
export function axes(hand, speed, { v, omega }) {
  const most = velocity(hand, speed, v / Math.min(speed, hand.v_max), 1).omega
  return { ahead: v / Math.min(speed, hand.v_max), left: most ? omega / most : 0 }
}
