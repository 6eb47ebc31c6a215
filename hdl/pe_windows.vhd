-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

-- Purpose:  The windows of inputs and outputs: what a host writes reaches the network together, and what it reads is of
--           one step.
-- Generics: Words are of 32 bits, word 0 lowest.
-- Timing:   A read is answered in its clock. take_i, capture_i and renew_i act at the end of the clock.

entity pe_windows is
  generic (
    WORD_BITS    : positive; -- address of a word in a window
    INPUT_WORDS  : natural;  -- words of inputs
    OUTPUT_WORDS : natural   -- words of outputs
  );
  port (
    clk_i      : in    std_ulogic;                                                    -- clock
    word_i     : in    std_ulogic_vector(WORD_BITS - 1 downto 0);                     -- word in a window
    write_i    : in    std_ulogic;                                                    -- writes it, in the window of inputs
    strobe_i   : in    std_ulogic_vector(3 downto 0);                                 -- bytes that are written
    data_i     : in    std_ulogic_vector(31 downto 0);                                -- what is written
    input_o    : out   std_ulogic_vector(31 downto 0);                                -- the word in the window of inputs
    is_input_o : out   std_ulogic;                                                    -- there is such an input
    output_o   : out   std_ulogic_vector(31 downto 0);                                -- the word in the window of outputs
    is_out_o   : out   std_ulogic;                                                    -- there is such an output
    all_out_o  : out   std_ulogic;                                                    -- all outputs can be read
    sample_o   : out   std_ulogic_vector(63 downto 0);                                -- step whose outputs these are
    take_i     : in    std_ulogic;                                                    -- inputs act from now on
    load_i     : in    std_ulogic;                                                    -- those of a frame do
    frame_i    : in    std_ulogic_vector(maximum(32 * INPUT_WORDS, 1) - 1 downto 0);  -- its words
    hold_i     : in    std_ulogic;                                                    -- outputs stay
    capture_i  : in    std_ulogic;                                                    -- outputs are new
    stepping_i : in    std_ulogic;                                                    -- a step is under way
    steps_i    : in    unsigned(63 downto 0);                                         -- steps that have ended
    initial_i  : in    std_ulogic_vector(maximum(32 * OUTPUT_WORDS, 1) - 1 downto 0); -- outputs of the initial state
    sampled_i  : in    std_ulogic_vector(maximum(OUTPUT_WORDS, 1) - 1 downto 0);      -- words that have a value in it
    renew_i    : in    std_ulogic;                                                    -- there is the initial state
    forget_i   : in    std_ulogic;                                                    -- there is another state
    inputs_o   : out   std_ulogic_vector(maximum(32 * INPUT_WORDS, 1) - 1 downto 0);  -- inputs of the network
    outputs_i  : in    std_ulogic_vector(maximum(32 * OUTPUT_WORDS, 1) - 1 downto 0)  -- outputs of the network
  );
end entity pe_windows;

architecture rtl of pe_windows is

  signal written : std_ulogic_vector(inputs_o'range)  := (others => '0');
  signal taken   : std_ulogic_vector(inputs_o'range)  := (others => '0');
  signal shown   : std_ulogic_vector(outputs_i'range) := (others => '0');
  signal first   : std_ulogic                         := '1'; -- outputs of the initial state
  signal defined : std_ulogic                         := '0'; -- outputs of a step
  signal missed  : std_ulogic                         := '0';
  signal sample  : unsigned(63 downto 0)              := (others => '0');
  signal capture : std_ulogic;
  signal all_of  : std_ulogic;                                -- all have a value in the initial state

begin

  -- What came while outputs were held is shown when no step can change it any more, or with the next one.
  capture <= not hold_i and (capture_i or (missed and not stepping_i));

  p_inputs : process (clk_i) is
  begin

    if rising_edge(clk_i) then

      for i in 0 to INPUT_WORDS - 1 loop

        for byte in 0 to 3 loop

          if (write_i = '1' and strobe_i(byte) = '1' and unsigned(word_i) = i) then
            written(32 * i + 8 * byte + 7 downto 32 * i + 8 * byte) <= data_i(8 * byte + 7 downto 8 * byte);
          end if;

        end loop;

      end loop;

      if (take_i = '1') then
        taken <= written;
      end if;

      if (load_i = '1') then
        taken <= frame_i;
      end if;
    end if;

  end process p_inputs;

  p_outputs : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      if (capture_i = '1') then
        missed <= '1';
      end if;

      if (capture = '1') then
        shown   <= outputs_i;
        first   <= '0';
        defined <= '1';
        missed  <= '0';
        sample  <= steps_i;

        if (capture_i = '1') then
          sample <= steps_i + 1;
        end if;
      end if;

      if (forget_i = '1') then
        first   <= '0';
        defined <= '0';
        missed  <= '0';
      end if;

      if (renew_i = '1') then
        first   <= '1';
        defined <= '0';
        missed  <= '0';
        sample  <= (others => '0');
      end if;
    end if;

  end process p_outputs;

  p_input : process (word_i, written) is

    variable merged : std_ulogic_vector(31 downto 0);

  begin

    merged := (others => '0');

    for i in 0 to INPUT_WORDS - 1 loop

      if (unsigned(word_i) = i) then
        merged := written(32 * i + 31 downto 32 * i);
      end if;

    end loop;

    input_o <= merged;

  end process p_input;

  p_output : process (word_i, shown, initial_i, sampled_i, first, defined) is

    variable merged : std_ulogic_vector(31 downto 0);
    variable found  : std_ulogic;

  begin

    merged := (others => '0');
    found  := '0';

    for i in 0 to OUTPUT_WORDS - 1 loop

      if (unsigned(word_i) = i) then
        merged := shown(32 * i + 31 downto 32 * i);
        found  := defined;

        if (first = '1') then
          merged := initial_i(32 * i + 31 downto 32 * i);
          found  := sampled_i(i);
        end if;
      end if;

    end loop;

    output_o <= merged;
    is_out_o <= found;

  end process p_output;

  p_all_of : process (sampled_i) is
  begin

    all_of <= '1';

    for i in 0 to OUTPUT_WORDS - 1 loop

      if (sampled_i(i) = '0') then
        all_of <= '0';
      end if;

    end loop;

  end process p_all_of;

  -- A bit more: GHDL 2.0 cuts a constant that does not fit the number it is compared with.
  is_input_o <= '1' when resize(unsigned(word_i), WORD_BITS + 1) < INPUT_WORDS else
                '0';
  all_out_o  <= defined or (first and all_of);
  sample_o   <= std_ulogic_vector(sample);
  inputs_o   <= taken;

end architecture rtl;
