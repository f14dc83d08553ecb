(* Weighted Theorem 1: diagonal weights make V = sum D_i e_i^2 + sum eps_i' P eps_i decay at the certified rate. *)
Require Import Reals List Lra Lia.
From Dobc Require Import Statement.
From Dobc Require Import Comparison.
From Dobc Require Import Consensus.
Import ListNotations.
Open Scope R_scope.

(* ---- A vector that proves a symmetric Z-matrix positive definite ---- *)

(* The identity behind it: x'Sx = sum_i (Sw)_i / w_i x_i^2 - 1/2 sum_ij S_ij w_i w_j (x_i / w_i - x_j / w_j)^2. *)
Lemma m_matrix_identity n (S : nat -> nat -> R) (w x : nat -> R) :
  (forall i j, (i < n)%nat -> (j < n)%nat -> S i j = S j i) ->
  (forall i, (i < n)%nat -> 0 < w i) ->
  sum n (fun i => sum n (fun j => S i j * x i * x j)) =
  sum n (fun i => sum n (fun j => S i j * w j) / w i * x i ^ 2)
  - / 2 * sum n (fun i => sum n (fun j => S i j * w i * w j * (x i / w i - x j / w j) ^ 2)).
Proof.
  intros Hsym Hw.
  set (rows := sum n (fun i => sum n (fun j => S i j * w j) / w i * x i ^ 2)).
  assert (Hrows : rows = sum n (fun i => sum n (fun j => S i j * w j / w i * x i ^ 2))).
  { apply sum_ext. intros i _. unfold Rdiv. rewrite <- !sum_scale_r. reflexivity. }
  (* the same sum, read by columns *)
  assert (Hcols : rows = sum n (fun i => sum n (fun j => S i j * w i / w j * x j ^ 2))).
  { rewrite Hrows, sum_swap. apply sum_ext. intros i Hi. apply sum_ext. intros j Hj.
    rewrite (Hsym j i) by assumption. reflexivity. }
  assert (Hsq : sum n (fun i => sum n (fun j => S i j * w i * w j * (x i / w i - x j / w j) ^ 2)) =
                rows + rows - 2 * sum n (fun i => sum n (fun j => S i j * x i * x j))).
  { rewrite Hrows at 1. rewrite Hcols, <- sum_scale, <- sum_add, <- sum_sub.
    apply sum_ext. intros i Hi. rewrite <- sum_scale, <- sum_add, <- sum_sub.
    apply sum_ext. intros j Hj. assert (Hwi := Hw i Hi). assert (Hwj := Hw j Hj). field. lra. }
  rewrite Hsq. lra.
Qed.

(* w > 0 with S w > 0 proves S > 0. *)
Theorem m_matrix_vector : forall n (S : nat -> nat -> R) (w : nat -> R),
  (forall i j, (i < n)%nat -> (j < n)%nat -> S i j = S j i) ->
  (forall i j, (i < n)%nat -> (j < n)%nat -> i <> j -> S i j <= 0) ->
  (forall i, (i < n)%nat -> 0 < w i) ->
  (forall i, (i < n)%nat -> 0 < sum n (fun j => S i j * w j)) ->
  forall x i, (i < n)%nat -> x i <> 0 -> 0 < sum n (fun i => sum n (fun j => S i j * x i * x j)).
Proof.
  intros n S w Hsym Hoff Hw HSw x i Hi Hx.
  rewrite (m_matrix_identity n S w x Hsym Hw).
  assert (Hpos : forall i, (i < n)%nat -> 0 < sum n (fun j => S i j * w j) / w i).
  { intros j Hj. apply Rdiv_lt_0_compat; auto. }
  assert (Hone : sum n (fun j => S i j * w j) / w i * x i ^ 2 <=
                 sum n (fun i => sum n (fun j => S i j * w j) / w i * x i ^ 2)).
  { apply (sum_term n (fun i => sum n (fun j => S i j * w j) / w i * x i ^ 2)); [|exact Hi].
    intros j Hj. apply Rmult_le_pos; [left; auto | apply pow2_ge_0]. }
  assert (Hx2 : 0 < x i ^ 2).
  { simpl. rewrite Rmult_1_r. exact (Rsqr_pos_lt _ Hx). }
  assert (H1 := Rmult_lt_0_compat _ _ (Hpos i Hi) Hx2).
  assert (H2 : 0 <= sum n (fun i => sum n (fun j => - (S i j * w i * w j * (x i / w i - x j / w j) ^ 2)))).
  { apply sum_nonneg. intros a Ha. apply sum_nonneg. intros b Hb.
    destruct (Nat.eq_dec a b) as [<-|Hab].
    - replace (x a / w a - x a / w a) with 0 by ring. lra.
    - replace (- (S a b * w a * w b * (x a / w a - x b / w b) ^ 2))
        with (- S a b * (w a * w b) * (x a / w a - x b / w b) ^ 2) by ring.
      assert (Hwa := Hw a Ha). assert (Hwb := Hw b Hb). assert (HS := Hoff a b Ha Hb Hab).
      apply Rmult_le_pos; [apply Rmult_le_pos; [lra | left; apply Rmult_lt_0_compat; lra] | apply pow2_ge_0]. }
  assert (H3 : sum n (fun i => sum n (fun j => - (S i j * w i * w j * (x i / w i - x j / w j) ^ 2))) =
             - sum n (fun i => sum n (fun j => S i j * w i * w j * (x i / w i - x j / w j) ^ 2))).
  { rewrite <- sum_opp. apply sum_ext. intros a _. apply sum_opp. }
  lra.
Qed.

(* ---- Weighted Theorem 1 ---- *)

(* V = sum D_i e_i^2 + sum eps_i' P_i eps_i at errors e and estimation errors eps. *)
Definition weighted_form (n : nat) (q : nat -> nat) (D : nat -> R) (P : nat -> nat -> nat -> R)
  (e : nat -> R) (eps : nat -> nat -> R) : R :=
  sum n (fun i => D i * e i ^ 2) + sum n (fun i => form (q i) (P i) (eps i)).

(* Omega0 = P F + F' P, F = A - W C. *)
Definition omega0 (q : nat) (P F : nat -> nat -> R) (k j : nat) : R :=
  sum q (fun h => P k h * F h j) + sum q (fun h => F h k * P h j).

(* The quadratic form of the block matrix [[-(DM + M'D) + 2 beta D, D (x) C], [., I (x) (Omega0 + 2 beta P)]]. *)
Definition block_form (n : nat) (q : nat -> nat) (M : nat -> nat -> R) (D : nat -> R)
  (Cout : nat -> nat -> R) (F P : nat -> nat -> nat -> R) (beta : R) (e : nat -> R) (eps : nat -> nat -> R) : R :=
  sum n (fun i => sum n (fun j =>
    (- (D i * M i j + M j i * D j) + (if Nat.eqb i j then 2 * beta * D i else 0)) * e i * e j))
  + 2 * sum n (fun i => sum (q i) (fun k => D i * Cout i k * e i * eps i k))
  + sum n (fun i => form (q i) (fun k j => omega0 (q i) (P i) (F i) k j + 2 * beta * P i k j) (eps i)).

(* The slope of a' P a along a' = F a is a' (P F + F' P) a. *)
Lemma form_slope_omega0 q P F a : form_slope q P F a = form q (omega0 q P F) a.
Proof.
  unfold form_slope, form, omega0, matvec.
  rewrite (sum_ext q _ (fun k => sum q (fun j => sum q (fun h => P k j * F k h * a h * a j))
                                 + sum q (fun j => sum q (fun h => P k j * a k * F j h * a h)))).
  2:{ intros k _. rewrite <- sum_add. apply sum_ext. intros j _.
      rewrite (sum_ext q (fun h => P k j * F k h * a h * a j) (fun h => P k j * a j * (F k h * a h)))
        by (intros; ring).
      rewrite (sum_ext q (fun h => P k j * a k * F j h * a h) (fun h => P k j * a k * (F j h * a h)))
        by (intros; ring).
      rewrite !sum_scale. ring. }
  rewrite (sum_ext q (fun k => sum q (fun j =>
      (sum q (fun h => P k h * F h j) + sum q (fun h => F h k * P h j)) * a k * a j))
    (fun k => sum q (fun j => sum q (fun h => P h j * F h k * a k * a j))
              + sum q (fun j => sum q (fun h => P k h * a k * F h j * a j)))).
  2:{ intros k _. rewrite <- sum_add. apply sum_ext. intros j _.
      rewrite (sum_ext q (fun h => P h j * F h k * a k * a j) (fun h => a k * a j * (F h k * P h j)))
        by (intros; ring).
      rewrite (sum_ext q (fun h => P k h * a k * F h j * a j) (fun h => a k * a j * (P k h * F h j)))
        by (intros; ring).
      rewrite !sum_scale. ring. }
  rewrite !sum_add. f_equal.
  - (* rename k and h *)
    rewrite (sum_swap q q (fun k j => sum q (fun h => P k j * F k h * a h * a j))).
    rewrite (sum_swap q q (fun k j => sum q (fun h => P h j * F h k * a k * a j))).
    apply sum_ext. intros j _. apply sum_swap.
  - apply sum_ext. intros k _. apply sum_swap.
Qed.

(* A form is linear in its matrix. *)
Lemma form_add q P1 P2 c a : form q (fun k j => P1 k j + c * P2 k j) a = form q P1 a + c * form q P2 a.
Proof.
  unfold form. rewrite <- sum_scale, <- sum_add. apply sum_ext. intros k _.
  rewrite <- sum_scale, <- sum_add. apply sum_ext. intros; ring.
Qed.

(* Along the linear loop, V' + 2 beta V is the block form. *)
Lemma weighted_slope n q M D Cout F P beta e eps :
  sum n (fun i => D i * (2 * e i * (- sum n (fun j => M i j * e j) + sum (q i) (fun k => Cout i k * eps i k))))
  + sum n (fun i => form_slope (q i) (P i) (F i) (eps i))
  + 2 * beta * weighted_form n q D P e eps
  = block_form n q M D Cout F P beta e eps.
Proof.
  unfold weighted_form, block_form.
  (* the observers *)
  rewrite (sum_ext n (fun i => form (q i) (fun k j => omega0 (q i) (P i) (F i) k j + 2 * beta * P i k j) (eps i))
    (fun i => form_slope (q i) (P i) (F i) (eps i) + 2 * beta * form (q i) (P i) (eps i)))
    by (intros; rewrite form_add, form_slope_omega0; reflexivity).
  rewrite sum_add, sum_scale.
  (* the network *)
  assert (Hnet : sum n (fun i => sum n (fun j =>
      (- (D i * M i j + M j i * D j) + (if Nat.eqb i j then 2 * beta * D i else 0)) * e i * e j))
    = - (2 * sum n (fun i => sum n (fun j => D i * M i j * e i * e j))) + 2 * beta * sum n (fun i => D i * e i ^ 2)).
  { assert (Ht : sum n (fun i => sum n (fun j => D i * M i j * e i * e j))
               = sum n (fun i => sum n (fun j => M j i * D j * e i * e j))).
    { rewrite sum_swap. apply sum_ext. intros i _. apply sum_ext. intros; ring. }
    replace (2 * sum n (fun i => sum n (fun j => D i * M i j * e i * e j)))
      with (sum n (fun i => sum n (fun j => D i * M i j * e i * e j))
            + sum n (fun i => sum n (fun j => M j i * D j * e i * e j))) by (rewrite <- Ht; ring).
    rewrite <- sum_add, <- sum_opp, <- sum_scale, <- sum_add. apply sum_ext. intros i Hi.
    rewrite <- sum_add.
    rewrite (sum_ext n _ (fun j => - (D i * M i j * e i * e j + M j i * D j * e i * e j)
       + (if Nat.eqb i j then 2 * beta * D i * e i * e j else 0)))
      by (intros j _; destruct (Nat.eqb i j); ring).
    rewrite sum_add, sum_opp. f_equal.
    rewrite (sum_split n _ i Hi), Nat.eqb_refl, sum_zero; [ring|].
    intros j _. destruct (Nat.eqb_spec j i) as [|Hj]; [reflexivity|].
    destruct (Nat.eqb_spec i j); [congruence | reflexivity]. }
  rewrite Hnet.
  (* the product rule, and the coupling of the two *)
  rewrite (sum_ext n
    (fun i => D i * (2 * e i * (- sum n (fun j => M i j * e j) + sum (q i) (fun k => Cout i k * eps i k))))
    (fun i => - (2 * sum n (fun j => D i * M i j * e i * e j))
              + 2 * sum (q i) (fun k => D i * Cout i k * e i * eps i k))).
  2:{ intros i _.
      rewrite (sum_ext n (fun j => D i * M i j * e i * e j) (fun j => D i * e i * (M i j * e j))) by (intros; ring).
      rewrite (sum_ext (q i) (fun k => D i * Cout i k * e i * eps i k)
        (fun k => D i * e i * (Cout i k * eps i k))) by (intros; ring).
      rewrite !sum_scale. ring. }
  rewrite sum_add, sum_opp, !sum_scale. ring.
Qed.

(* Weighted Theorem 1, the direction that a certificate uses: the block inequality makes V decay at the rate 2 beta.
   Every agent may have an exosystem of its own; the theory page has the same q, C, F, P for all. *)
Theorem weighted_theorem_1 : forall T n (q : nat -> nat) (M : nat -> nat -> R) (D : nat -> R)
  (Cout : nat -> nat -> R) (F P : nat -> nat -> nat -> R) beta (e : nat -> R -> R) (eps : nat -> nat -> R -> R),
  (forall i, (i < n)%nat -> evolves (T := T) (e i) (fun t =>
     - sum n (fun j => M i j * e j t) + sum (q i) (fun k => Cout i k * eps i k t))) ->
  (forall i k, (i < n)%nat -> (k < q i)%nat -> evolves (T := T) (eps i k) (fun t => sum (q i) (fun j => F i k j * eps i j t))) ->
  (forall a b, block_form n q M D Cout F P beta a b <= 0) ->
  let V t := weighted_form n q D P (fun i => e i t) (fun i k => eps i k t) in
  forall t, 0 <= t < T -> V t <= V 0 * exp (- (2 * beta * t)).
Proof.
  intros T n q M D Cout F P beta e eps He Heps Hblock V t Ht.
  set (V' := fun t =>
    sum n (fun i => D i * (2 * e i t * (- sum n (fun j => M i j * e j t) + sum (q i) (fun k => Cout i k * eps i k t))))
    + sum n (fun i => form_slope (q i) (P i) (F i) (fun k => eps i k t))).
  apply (decays (T := T) V V'); [| |exact Ht].
  - apply evolves_plus.
    + apply (evolves_sum n (fun i t => D i * e i t ^ 2) (fun i t => D i * (2 * e i t *
        (- sum n (fun j => M i j * e j t) + sum (q i) (fun k => Cout i k * eps i k t))))).
      intros i Hi.
      eapply evolves_eq; [exact (evolves_scale (D i) _ _ (evolves_mult _ _ _ _ (He i Hi) (He i Hi))) | |];
        intros; simpl; ring.
    + apply (evolves_sum n (fun i t => form (q i) (P i) (fun k => eps i k t))
        (fun i t => form_slope (q i) (P i) (F i) (fun k => eps i k t))).
      intros i Hi. apply form_evolves. intros k Hk. apply Heps; assumption.
  - intros u _.
    assert (Hs := weighted_slope n q M D Cout F P beta (fun i => e i u) (fun i k => eps i k u)).
    specialize (Hblock (fun i => e i u) (fun i k => eps i k u)). unfold V, V'. lra.
Qed.

(* What it says of each agent: D > 0 and P >= 0 bound the error itself. *)
Corollary weighted_errors_decay : forall T n (q : nat -> nat) (M : nat -> nat -> R) (D : nat -> R)
  (Cout : nat -> nat -> R) (F P : nat -> nat -> nat -> R) beta (e : nat -> R -> R) (eps : nat -> nat -> R -> R),
  (forall i, (i < n)%nat -> 0 < D i) -> (forall i a, (i < n)%nat -> 0 <= form (q i) (P i) a) ->
  (forall i, (i < n)%nat -> evolves (T := T) (e i) (fun t =>
     - sum n (fun j => M i j * e j t) + sum (q i) (fun k => Cout i k * eps i k t))) ->
  (forall i k, (i < n)%nat -> (k < q i)%nat -> evolves (T := T) (eps i k) (fun t => sum (q i) (fun j => F i k j * eps i j t))) ->
  (forall a b, block_form n q M D Cout F P beta a b <= 0) ->
  forall t i, 0 <= t < T -> (i < n)%nat ->
  e i t ^ 2 <= weighted_form n q D P (fun i => e i 0) (fun i k => eps i k 0) / D i * exp (- (2 * beta * t)).
Proof.
  intros T n q M D Cout F P beta e eps HD HP He Heps Hblock t i Ht Hi.
  assert (H := weighted_theorem_1 T n q M D Cout F P beta e eps He Heps Hblock t Ht). simpl in H.
  assert (H1 : D i * e i t ^ 2 <= weighted_form n q D P (fun i => e i t) (fun i k => eps i k t)).
  { unfold weighted_form.
    assert (0 <= sum n (fun i => form (q i) (P i) (fun k => eps i k t)))
      by (apply sum_nonneg; intros; apply HP; assumption).
    assert (D i * e i t ^ 2 <= sum n (fun i => D i * e i t ^ 2)); [|lra].
    apply (sum_term n (fun i => D i * e i t ^ 2)); [|exact Hi].
    intros j Hj. apply Rmult_le_pos; [left; auto | apply pow2_ge_0]. }
  specialize (HD i Hi).
  apply (Rmult_le_reg_l (D i)); [exact HD|].
  eapply Rle_trans; [exact H1|]. eapply Rle_trans; [exact H|]. right. field. lra.
Qed.

(* ---- The printed loop with linear couplings is of this form ---- *)

(* M = L + K: the Laplacian of the arcs with weights w, and the pinning gains. *)
Definition network_matrix (l : loop) (w : arc -> R) (i j : nat) : R :=
  fold_right Rplus 0 (map (fun a =>
    if Nat.eqb (listener a) i
    then w a * ((if Nat.eqb j i then 1 else 0) - (if Nat.eqb j (speaker a) then 1 else 0))
    else 0) (arcs l 0))
  + (if Nat.eqb j i then gain l i 0 0 else 0).

(* A unit vector picks one term of a sum. *)
Lemma sum_pick n f c : (c < n)%nat -> sum n (fun j => (if Nat.eqb j c then 1 else 0) * f j) = f c.
Proof.
  intros Hc. rewrite (sum_split n _ c Hc), Nat.eqb_refl, sum_zero; [ring|].
  intros j _. destruct (Nat.eqb j c); ring.
Qed.

(* What an agent hears, minus its pinning, is - M e. *)
Lemma linear_row l w i e :
  (i < agents l)%nat ->
  (forall a, In a (arcs l 0) -> (speaker a < agents l)%nat) ->
  (forall a y, In a (arcs l 0) -> coupling a y = w a * y) ->
  row l 0 i e - gain l i 0 0 * e i = - sum (agents l) (fun j => network_matrix l w i j * e j).
Proof.
  intros Hi Hin Hlin. unfold row, network_matrix.
  rewrite (sum_ext (agents l) _ (fun j =>
    fold_right Rplus 0 (map (fun a =>
      if Nat.eqb (listener a) i
      then w a * ((if Nat.eqb j i then 1 else 0) - (if Nat.eqb j (speaker a) then 1 else 0))
      else 0) (arcs l 0)) * e j
    + gain l i 0 0 * ((if Nat.eqb j i then 1 else 0) * e j)))
    by (intros j _; destruct (Nat.eqb j i); ring).
  rewrite sum_add, sum_scale, sum_pick by exact Hi.
  match goal with |- ?r - ?g = - (?s + ?g) => enough (r = - s) by lra end.
  revert Hin Hlin. generalize (arcs l 0). intros list.
  induction list as [|a list IH]; simpl; intros Hin Hlin.
  - rewrite sum_zero; [ring | intros; ring].
  - rewrite IH by (intros; (apply Hin || apply Hlin); right; assumption).
    match goal with |- _ = - sum _ ?full => rewrite (sum_ext (agents l) full (fun j =>
      (if Nat.eqb (listener a) i then w a else 0)
        * ((if Nat.eqb j i then 1 else 0) * e j - (if Nat.eqb j (speaker a) then 1 else 0) * e j)
      + fold_right Rplus 0 (map (fun a =>
          if Nat.eqb (listener a) i
          then w a * ((if Nat.eqb j i then 1 else 0) - (if Nat.eqb j (speaker a) then 1 else 0))
          else 0) list) * e j))
      by (intros j _; destruct (Nat.eqb (listener a) i); ring) end.
    rewrite sum_add, sum_scale, sum_sub, !sum_pick by (exact Hi || (apply Hin; left; reflexivity)).
    destruct (Nat.eqb (listener a) i); [rewrite Hlin by (left; reflexivity)|]; ring.
Qed.

(* One graph, one component, couplings h(y) = w y: the errors of the printed loop meet the hypotheses of weighted
   Theorem 1 with M = L + K, the output rows of C, and F = A - W C. *)
Theorem linear_loop : forall l w T mode x xi z,
  modes l = 1%nat -> components l = 1%nat ->
  (forall a, In a (arcs l 0) -> (speaker a < agents l)%nat) ->
  (forall a y, In a (arcs l 0) -> coupling a y = w a * y) ->
  (forall t, 0 <= t < T -> (mode t < modes l)%nat) ->
  closed_loop l T mode x xi z ->
  (forall i, (i < agents l)%nat -> evolves (T := T) (error l x i 0) (fun t =>
     - sum (agents l) (fun j => network_matrix l w i j * error l x j 0 t)
     + sum (order l i) (fun k => C l i 0 k * estimation_error l x xi z i k t))) /\
  (forall i k, (i < agents l)%nat -> (k < order l i)%nat -> evolves (T := T) (estimation_error l x xi z i k) (fun t =>
     sum (order l i) (fun j => observer_matrix l i k j * estimation_error l x xi z i j t))).
Proof.
  intros l w T mode x xi z Hone Hm Hin Hlin Hmode H. split.
  - intros i Hi. eapply evolves_eq; [exact (error_evolves l T mode x xi z H i 0%nat Hi ltac:(lia)) | reflexivity |].
    intros t Ht. simpl.
    assert (Ht0 : mode t = 0%nat) by (specialize (Hmode t Ht); lia). rewrite Ht0, Hm.
    rewrite <- (linear_row l w i (fun j => error l x j 0 t)) by assumption. simpl. ring.
  - intros i k Hi Hk. exact (estimation_error_evolves l T mode x xi z H i k Hi Hk).
Qed.

(* The two together: the printed loop under the block inequality. *)
Corollary linear_loop_decays : forall l w D P beta T mode x xi z,
  modes l = 1%nat -> components l = 1%nat ->
  (forall a, In a (arcs l 0) -> (speaker a < agents l)%nat) ->
  (forall a y, In a (arcs l 0) -> coupling a y = w a * y) ->
  (forall a b, block_form (agents l) (order l) (network_matrix l w) D (fun i => C l i 0) (observer_matrix l) P beta a b <= 0) ->
  (forall t, 0 <= t < T -> (mode t < modes l)%nat) ->
  closed_loop l T mode x xi z ->
  let V t := weighted_form (agents l) (order l) D P
               (fun i => error l x i 0 t) (fun i k => estimation_error l x xi z i k t) in
  forall t, 0 <= t < T -> V t <= V 0 * exp (- (2 * beta * t)).
Proof.
  intros l w D P beta T mode x xi z Hone Hm Hin Hlin Hblock Hmode H.
  destruct (linear_loop l w T mode x xi z Hone Hm Hin Hlin Hmode H) as (He & Heps).
  exact (weighted_theorem_1 T _ _ _ D _ _ P beta (fun i => error l x i 0) (estimation_error l x xi z) He Heps Hblock).
Qed.
